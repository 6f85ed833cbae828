"""Shows a run that has results on the terminal: its reports and their table; and the table of a score."""

from collections.abc import Sequence
from typing import Any

from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table as RichTable

from radiogs_reports.analysis.beside import beside_report
from radiogs_reports.summary import Summary, protocol_title
from radiogs_reports.tables.caption import preset_and_recipe, published_note
from radiogs_reports.tables.model import Column, PrintedCell, Table
from radiogs_reports.tables.record import HEADING, record_reports
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.wording import count_of, marked, mean_over

from ..results.reports import EVERYTHING, Shown, write
from ..runs.sweep import Sweep
from ..scoring.metrics.protocol import Protocol
from ..scoring.metrics.weights import complaint
from ..scoring.score_record import NOTES
from ..store.folder import Store
from ..store.schema import MetricValue
from .reporter import complain, console, say, say_aside, show

PAGE = "report.html"


def write_and_show(store: Store, sweep: Sweep, shown: Shown = EVERYTHING, width: int | None = None) -> None:
    """Rebuild the summary and the reports of a run, and print the table in lines of ``width`` characters (default: as
    many as the terminal has); the last line names the page."""
    summary, written = write(store, sweep, shown)
    table = suite_table(summary)
    for part in parts_of(table, title_of(summary), console(width).width):
        show(part, width)
    say(*below(table))
    if more := len(table.remarks):  # they would fill a screen, and the page has them
        say(f"The page has {count_of(more, 'remark')} more, on what differs from the published and what is not known.")
    say(f"Mean over {mean_over(summary)}.")
    say(f"Metric protocol: {protocol_title(summary)}; {preset_and_recipe(summary)}. {published_note(summary)}")
    show_records(summary, width)
    if (compared := beside_report(summary)) is not None:
        say(*compared.sentences)
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
    for run, report in zip(summary.get("longer_runs", []), record_reports(summary), strict=True):
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
        say(*found, *report.table.legend_in_words, *report.rows_in_words)
    if others:
        say(f"\nThe page also shows {count_of(others, 'longer run')} by other recipes, committed with the project.")


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
    """A table, cut between columns where ``width`` characters do not hold it; the first part has the title."""
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
    scenes = ", ".join(marked(summary, scene) for scene in summary["scenes"])
    return f"{summary['title']}: {scenes}, seeds {seeds}, preset {summary['preset']}"


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


def entry(cell: PrintedCell) -> str:
    """Mean with its marks, paired difference with its interval, verdict and published value, each on a line."""
    lines = [f"{cell.text}{cell.marks}"]
    if cell.difference is not None:
        lines.append(cell.difference.plus_minus)
    if cell.verdict is not None:
        lines.append(cell.verdict)
    if cell.published is not None:
        lines.append(f"paper {cell.published.text}")
    return "\n".join(lines)


def say_without_weights(protocols: Sequence[Protocol]) -> None:
    """Warn of each network whose weights are missing: its metrics are n/a."""
    for net in dict.fromkeys(each.net for rules in protocols for each in rules.lpips):
        if complaint(net):
            complain(complaint(net))


def show_record(record: dict[str, Any]) -> None:
    """Print a record's table and its notes."""
    show(table_of(record))
    for heading in NOTES:
        for line in record[heading]:
            say(f"{heading.removesuffix('s')}: {line}")


def table_of(record: dict[str, Any]) -> RichTable:
    """A score's record as a table of metrics by protocol; with a single protocol, missing values give their reason."""
    table = RichTable("metric", title=f"{record['predictions']} ({record['from']})")
    for each in record["protocols"].values():
        table.add_column(each["conventions"]["title"], justify="right")
    if len(record["protocols"]) == 1:
        table.add_column("why not")
    metrics = sorted({metric for each in record["protocols"].values() for metric in each["metrics"]})
    for metric in metrics:
        values = [each["metrics"].get(metric) for each in record["protocols"].values()]
        reasons = [(values[0] or {}).get("reason") or ""] if len(values) == 1 else []
        table.add_row(metric, *map(_shown, values), *reasons)
    return table


def _shown(metric: MetricValue | None) -> str:
    if metric is None:
        return ""
    return "n/a" if metric["value"] is None else f"{metric['value']:.4f}"
