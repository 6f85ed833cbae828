"""Shows a run that has results on the terminal: its reports and their table.

A suite's table is cut into as many tables below each other as the width needs, so that no number is cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table as RichTable

from radiogs_baselines.published import values_beside
from radiogs_core.errors import UsageError
from radiogs_reports.analysis.beside import beside_report, other_run
from radiogs_reports.run_folder import write_reports
from radiogs_reports.summary import OtherRun, Summary, protocol_title, row_texts
from radiogs_reports.tables.caption import origin, preset_and_recipe, published_note
from radiogs_reports.tables.longer_run import HEADING, longer_reports
from radiogs_reports.tables.model import Cell, Column, Table
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.wording import count_of, mean_over

from ..results.longer_run import records_of
from ..results.summary import summarise
from ..runs.progress import progress_for_stderr
from ..runs.sweep import Sweep, of_scenes, read_sweep
from ..store.atomic import explained
from ..store.folder import Store
from ..store.seal import write_sealed
from .aside import damage_explained, say_aside
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
    say(f"Mean over {mean_over(summary)}.")
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
    """Print the record of a longer run of some of these rows by the same recipe, and a sentence for each row: in which
    columns this run agrees. Records by other recipes are counted; the page shows them.
    """
    rows, others = {row["key"] for row in summary["rows"]}, 0
    for run, report in zip(summary.get("longer_runs", []), longer_reports(summary), strict=True):
        if rows.isdisjoint(row["key"] for row in run["rows"]):
            continue
        if run["recipe"] != summary.get("recipe", ""):
            others += 1
            continue
        say(f"\n{HEADING}")
        for name, text in report.facts.items():
            say(f"{name}: {text}")
        for part in parts_of(report.table, f"Record: {report.title}", console(width).width):
            show(part, width)
        found = [each.plain for each in report.table.findings]
        for sentence in (*found, *report.table.legend_in_words, *report.rows_in_words):
            say(sentence)
    if others:
        say(f"\nThe page also shows {count_of(others, 'longer run')} by other recipes, committed with the project.")


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
