"""Shows a run on the terminal: its reports and their table once it has results, or what it will take beforehand.

A suite's table is cut into as many tables below each other as the width needs, so that no number is cut.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table as RichTable

from radiogs_baselines.published import values_beside
from radiogs_core.errors import UsageError
from radiogs_reports.analysis.beside import beside_report, other_run
from radiogs_reports.analysis.power import Plan, Planned, planned
from radiogs_reports.run_folder import write_reports
from radiogs_reports.statistics import Level
from radiogs_reports.summary import OtherRun, Summary, protocol_title, read_summary, row_texts
from radiogs_reports.tables.caption import origin, preset_and_recipe, published_note
from radiogs_reports.tables.longer_run import HEADING, longer_reports
from radiogs_reports.tables.model import Cell, Column, Table
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.wording import count_of

from ..durations import duration
from ..results.longer_run import records_of
from ..results.summary import summarise
from ..runs.forecast import Expected, forecast, total
from ..runs.progress import progress_for_stderr
from ..runs.sweep import CellRef, Request, Sweep, label, of_scenes, preset_text, read_sweep, recipe_of_rows, state_of
from ..store.atomic import explained
from ..store.folder import Store
from ..store.seal import write_sealed
from .aside import damage_explained, say_aside
from .events import emit
from .reporter import console, say, show

PAGE = "report.html"


@dataclass(frozen=True)
class Shown:
    """How much of a run its reports show."""

    alone: bool = False
    """Whether the page has to be a single file."""
    scenes: Sequence[str] = ()
    """The scenes that are reported on; all, if it is empty."""
    pictures: bool = True
    """Whether there are figures, images and surfels, which take nearly all of the time."""
    width: int | None = None
    """Characters of a line of the printed table; None: as many as the terminal has."""
    beside: Path | None = None
    """Folder of another run, to which this one is compared."""


EVERYTHING = Shown()


def write_and_show(store: Store, sweep: Sweep, shown: Shown = EVERYTHING) -> None:
    """Rebuild the summary and the reports of a run, print the table; the last line says what to open."""
    summary, written = write(store, sweep, shown)
    table = suite_table(summary)
    for part in parts_of(table, title_of(summary), console(shown.width).width):
        show(part, shown.width)
    for sentence in below(table):
        say(sentence)
    say_remarks(table)
    say(f"Metric protocol: {protocol_title(summary)}; {preset_and_recipe(summary)}. {published_note(summary)}")
    show_records(summary, shown.width)
    if (compared := beside_report(summary)) is not None:
        for sentence in compared.sentences:
            say(sentence)
    say_aside(store)
    say(f"{len(written)} files in {store.folder}; open {store.folder / PAGE}")


def below(table: Table) -> list[str]:
    """The sentences below a table: its findings, how to read it, why values are missing, and footnotes."""
    found = [each.plain for each in table.findings]
    return [*found, explanation(table), *table.legend_in_words, *reasons(table), *table.footnotes]


def show_records(summary: Summary, width: int | None) -> None:
    """Print the record of the suite's longer runs, and a sentence for each row: in which columns this run agrees."""
    for report in longer_reports(summary):
        say(f"\n{HEADING}")
        for name, text in report.facts.items():
            say(f"{name}: {text}")
        for part in parts_of(report.table, f"Record: {report.title}", console(width).width):
            show(part, width)
        found = [each.plain for each in report.table.findings]
        for sentence in (*found, *report.table.legend_in_words, *report.rows_in_words):
            say(sentence)


def say_remarks(table: Table) -> None:
    """Print the number of remarks; the remarks themselves would fill a screen, and the page has them."""
    count = len(table.remarks)
    if count:
        say(f"The page has {count_of(count, 'remark')} more, on what differs from the published and what is not known.")


def write(store: Store, sweep: Sweep, shown: Shown = EVERYTHING) -> tuple[Summary, list[Path]]:
    """Rebuild the summary and the reports of a run, given by its manifest; returns the summary and all files.

    Raises UsageError for a scene that the run does not have.
    """
    part = of_scenes(sweep, shown.scenes or sweep["scenes"])
    summary = summarise(store, part, *values_beside(sweep["published"], sweep["columns"]))
    if left := [name for name in sweep["scenes"] if name not in part["scenes"]]:
        summary["left_out"] = left
    if longer := records_of(summary["suite"]):
        summary["longer_runs"] = longer
    if shown.beside is not None:
        summary["beside"] = run_beside(summary, shown.beside)
    with store.patient_claim("summary"), progress_for_stderr() as progress:
        write_sealed(store.folder / "summary.json", summary)
        with explained(store.folder), damage_explained():
            told = partial(progress.advance, "figures, tables, page")
            written = write_reports(store.folder, shown.alone, told, shown.pictures)
    return summary, [store.folder / "summary.json", *written]


def run_beside(summary: Summary, folder: Path) -> OtherRun:
    """The run in ``folder``, from its stored results, to be compared with another run.

    Raises UsageError for results of another metric protocol, and where the two share no cell.
    """
    sweep = read_sweep(folder)
    other = summarise(Store(folder), sweep, *values_beside(sweep["published"], sweep["columns"]))
    here, there = protocol_title(summary), protocol_title(other)
    if here != there:
        raise UsageError(
            f"{folder} was scored under metric protocol {there}, this run under {here}",
            "Their values follow other conventions, so that a difference would not say which run is better.",
            f"Run one of them again with --protocol {summary['protocol']}, or with the other's version of the harness.",
        )
    cells = [
        {(run["row"], run["scene"], run["seed"]) for run in each["runs"] if run["metrics"]} for each in (summary, other)
    ]
    if not cells[0] & cells[1]:
        raise UsageError(
            f"{folder} has no finished cell of the same row, scene and seed",
            f"Its rows are {', '.join(row_texts(other))}, on {', '.join(other['scenes'])}.",
            "Name a run of the same suite.",
        )
    return other_run(other, folder.resolve().name, origin(other))


def explanation(table: Table) -> str:
    """A sentence that explains the lines below each value in the table."""
    if table.reference is None:
        return "The rows are not variants of one method, so no differences are shown."
    return (
        f"Below each value: its difference to '{table.reference.text}', with the half-width of its 95 % interval where"
        " there are several scenes or seeds; better or worse, where that is resolved."
    )


def reasons(table: Table) -> list[str]:
    """Why values are missing: each reason once, with its columns."""
    return [f"missing in {', '.join(labels)}: {reason}" for reason, labels in table.missing.items()]


LABEL = 24
"""Most characters in a line of a row's label; longer labels are wrapped, and nothing else is."""


Texts = tuple[str, list[str]]
"""The heading of a column, and its text in each row."""


def parts_of(table: Table, title: str, width: int) -> list[RichTable]:
    """A table, cut between columns where ``width`` characters do not hold it; the first part has the title.

    A column that is too wide on its own is alone in its part.
    """
    label: Texts = "", [row.text for row in table.rows]
    columns = [texts_of(table, place) for place in range(len(table.columns))]
    parts = []
    room = width - drawn(min(LABEL, lines_of(label))) - 1
    while columns:
        count = next((n for n in range(len(columns), 1, -1) if needed(columns[:n]) <= room), 1)
        parts.append(table_part(label, columns[:count]))
        columns = columns[count:]
    parts[0].title = escape(title)
    return parts


def needed(columns: Sequence[Texts]) -> int:
    """Characters that columns take when nothing is wrapped."""
    return sum(drawn(lines_of(column)) for column in columns)


def drawn(width: int) -> int:
    """Characters that a column of ``width`` characters takes with its margins and the line beside it."""
    return width + 3


def lines_of(column: Texts) -> int:
    """Characters of the longest line of a column."""
    heading, entries = column
    return max(cell_len(line) for text in (heading, *entries) for line in text.split("\n"))


def title_of(summary: Summary) -> str:
    """The suite's title, with the scenes, seeds and preset of the run."""
    seeds = ", ".join(map(str, summary["seeds"]))
    return f"{summary['title']}: {', '.join(summary['scenes'])}, seeds {seeds}, preset {summary['preset']}"


def table_part(label: Texts, columns: Sequence[Texts]) -> RichTable:
    """A table of the rows' labels and some columns; only the labels may be wrapped."""
    made = RichTable(show_lines=True)
    made.add_column(label[0], max_width=LABEL)
    for heading, _ in columns:
        made.add_column(heading, no_wrap=True, justify="right")
    for place, text in enumerate(label[1]):
        made.add_row(escape(text), *(entries[place] for _, entries in columns))
    return made


def texts_of(table: Table, place: int) -> Texts:
    """The texts of a column."""
    return heading(table.columns[place]), [entry(row.cells[place]) for row in table.rows]


def heading(column: Column) -> str:
    """A column's label, a word or two a line, with the better direction and its unit."""
    task, _, measure = column.label.partition(" ")
    last = f"{measure or task} {column.arrow}"
    return "\n".join([*([task] if measure else []), last, *([f"({column.unit})"] if column.unit else [])])


def entry(cell: Cell) -> str:
    """Mean with its marks, paired difference with its interval, verdict and published value, each on a line."""
    lines = [f"{cell.text}{cell.marks}"]
    if cell.difference is not None:
        lines.append(cell.difference.plus_minus)
    if cell.verdict is not None:
        lines.append(cell.verdict)
    if cell.published is not None:
        lines.append(f"paper {cell.published.text}")
    return "\n".join(lines)


UNKNOWN = "unknown"
"""Time or memory of a cell when the store has measured nothing like it."""


def show_plan(request: Request, store: Store, at_a_time: int, threads: int, wanted: Mapping[str, float]) -> None:
    """Print every cell, its state, and forecasts from the store: time, memory and the differences that would be
    resolved.

    ``at_a_time`` cells run at the same time, each on ``threads`` threads. ``wanted``: differences by column.
    """
    cells = request.own_cells()
    expected = forecast(store, [cell for _, cell in cells])
    preset = preset_text(request.preset, request.settings)
    table = RichTable("cell", "key", "state", "time", "memory", title=escape(f"{request.suite.title}, preset {preset}"))
    for (place, _), each in zip(cells, expected, strict=True):
        row = ("", "") if each is None else (UNKNOWN if each.seconds is None else duration(each.seconds), memory(each))
        table.add_row(label(place), place["key"], state_of(store, place), *row)
    show(table)
    missing = sum(each is not None for each in expected)
    say(f"{missing} of {len(cells)} cells to run")
    if missing:
        say(f"time, one after the other: {whole_time(expected)}{how_measured(store, threads)}")
        if at_a_time > 1:
            say(f"time, {at_a_time} at a time: {whole_time(expected, at_a_time)}")
        say(f"memory of one process: {whole_memory(expected)}")
        for sentence in recorded_plan(
            request, [place for (place, _), each in zip(cells, expected, strict=True) if each]
        ):
            say(sentence)
    for sentence in power_sentences(request, store, wanted):
        say(sentence)


def recorded_plan(request: Request, missing: Sequence[CellRef]) -> list[str]:
    """Sentences on what these cells took, and what the run could show, in the suite's record of the same preset, recipe
    and protocol; none where there is no such record with all their rows."""
    recipe, preset = recipe_of_rows(request.manifest([])["rows"]), preset_text(request.preset, request.settings)
    sentences = []
    for run in records_of(request.suite.name):
        seconds = {row["key"]: row["seconds"] for row in run["rows"]}
        known = [taken for ref in missing if (taken := seconds.get(ref["row"])) is not None]
        alike = (run["recipe"], run["preset"], run["protocol"]) == (recipe, preset, request.protocol)
        if not alike or len(known) < len(missing):
            continue
        smallest = [
            f"{column['label']} {column['smallest']:.{column['decimals']}f} {column['unit']}".rstrip()
            for column in run["columns"]
            if column.get("smallest") is not None
        ]
        date, seeds = run["origin"].get("Date", "an unknown date"), count_of(len(run["seeds"]), "seed")
        sentences.append(
            f"In the record of {date}, training took {duration(sum(known))} for these cells, one after the other"
            f" ({run['machine']}; a stage that rows share counts in each). Four of five such runs"
            f" ({count_of(len(run['scenes']), 'scene')}, {seeds}) would resolve true differences of"
            f" {', '.join(smallest) or 'an unknown size, for want of scenes or seeds'}."
        )
    return sentences


def power_sentences(request: Request, store: Store, wanted: Mapping[str, float]) -> list[str]:
    """Sentences on the differences that the run could resolve, by the spread in the store's last summary."""
    found = [each for each in power_of(request, store, wanted) if each.smallest is not None or each.wanted is not None]
    if not found:
        return [
            "The smallest differences that it could show are not known: no summary of this suite with several scenes"
            f" or seeds is in {store.folder}. A run writes it; of a run by another version:  radiogs-bench report"
            f" {store.folder}"
        ]
    smallest = [f"{each.column['label']} {amount(each, each.smallest)}" for each in found if each.smallest is not None]
    sentences = [
        f"The smallest true differences that would be resolved in four of five such runs: {', '.join(smallest)}."
    ]
    return [*(sentences if smallest else []), *(needs(each) for each in found if each.wanted is not None)]


def amount(of: Planned, size: float | None) -> str:
    """A difference with the decimals and the unit of its column."""
    return f"{size:.{of.column['decimals']}f} {of.column['unit']}".rstrip() if size is not None else UNKNOWN


MORE: Mapping[Level, tuple[str, str]] = {
    "kinds": ("kind", "of scenes, each with as many scenes and seeds as now"),
    "scenes": ("scene", "of each kind, with as many seeds as now"),
    "seeds": ("seed", "on as many scenes as now"),
}


def needs(of: Planned) -> str:
    """How many kinds of scenes, scenes or seeds a wanted difference needs, as a sentence."""
    ways = [f"{count_of(count, MORE[level][0])} {MORE[level][1]}" for level, count in of.needed.items()]
    found = ", or ".join(ways) or "neither scenes nor seeds that the stored spread tells of"
    return f"To resolve {amount(of, of.wanted)} of {of.column['label']} in four of five runs: {found}."


def power_of(request: Request, store: Store, wanted: Mapping[str, float]) -> list[Planned]:
    """The differences that each column of the run could resolve; empty where no run of this suite is stored.

    Raises UsageError for a wanted difference in a column that the suite does not have.
    """
    columns = [metric.key for metric in request.suite.columns]
    for name in wanted:
        if name not in columns:
            raise UsageError(f"--difference: '{name}' is no column of suite '{request.suite.name}'", "",
                             f"Its columns: {', '.join(columns)}.")  # fmt: skip
    try:
        summary = read_summary(store.folder)
    except (OSError, ValueError):  # none yet, or of another version: only a run tells then
        return []
    if summary["suite"] != request.suite.name:
        return []
    scenes = Counter(request.kinds().get(name, "") for name in request.scenes)
    return planned(summary, Plan(len(scenes), min(scenes.values()), request.seeds), wanted)


def emit_plan(request: Request, store: Store, wanted: Mapping[str, float]) -> None:
    """The plan as events: one per cell, then one per column with a stored spread; null for unknown values."""
    cells = request.own_cells()
    for (place, cell), each in zip(cells, forecast(store, [cell for _, cell in cells]), strict=True):
        rest = {} if each is None else asdict(each)
        emit("planned", cell=label(place), key=cell.key, state=state_of(store, place), **rest)
    for found in power_of(request, store, wanted):
        emit("power", **{**found._asdict(), "column": found.column["key"]})


def how_measured(store: Store, threads: int) -> str:
    """A remark if the store's cells ran on another number of threads: their seconds are then not comparable."""
    seen = {
        session["machine"]["threads"]
        for result in store.results()
        for sessions in result["sessions"].values()
        for session in sessions
    }
    if seen <= {threads}:
        return ""
    return f" (measured on {' or '.join(map(str, sorted(seen)))} threads a cell; here a cell has {threads})"


def whole_time(expected: Sequence[Expected | None], at_a_time: int = 1) -> str:
    """Time of all missing cells; cells run at a time share the work evenly, or the longest one decides."""
    seconds, unknown = total(expected)
    longest = max((each.seconds or 0.0 for each in expected if each is not None), default=0.0)
    seconds = max(seconds / at_a_time, longest)
    missing = sum(each is not None for each in expected)
    if unknown == missing:
        return f"{UNKNOWN} (the store has measured nothing like it)"
    return f"about {duration(seconds)}" + (f", and {unknown} cells of which it is {UNKNOWN}" if unknown else "")


def whole_memory(expected: Sequence[Expected | None]) -> str:
    """Largest memory estimate of any missing cell."""
    known = [each for each in expected if each is not None and each.host_bytes is not None]
    if not known:
        return UNKNOWN
    most = max(known, key=lambda each: (each.host_bytes or 0, each.device_bytes or 0))
    return f"up to {memory(most)}"


def memory(expected: Expected) -> str:
    """Memory of the host, and of the GPU if one was used."""
    if expected.host_bytes is None:
        return UNKNOWN
    device = "" if expected.device_bytes is None else f", GPU {expected.device_bytes / 2**30:.2f} GiB"
    return f"{expected.host_bytes / 2**30:.2f} GiB{device}"
