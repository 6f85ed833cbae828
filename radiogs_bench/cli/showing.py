"""Shows a run that has results on the terminal: its reports and their table; and the table of a score."""

import math
import sys
from collections.abc import Sequence
from textwrap import wrap
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table as RichTable

from radiogs_reports.analysis.beside import beside_report
from radiogs_reports.summary import Summary, protocol_title
from radiogs_reports.tables.caption import preset_and_recipe
from radiogs_reports.tables.doubts import MARKS
from radiogs_reports.tables.model import Column, PrintedCell, Table
from radiogs_reports.tables.record import record_reports
from radiogs_reports.tables.suite import suite_table
from radiogs_reports.wording import mean_over, number

from ..results.reports import EVERYTHING, Shown, write
from ..runs.sweep import Sweep
from ..scoring.metrics.protocol import Protocol
from ..scoring.metrics.weights import complaint
from ..scoring.score_record import NOTES
from ..store.folder import Store
from ..store.schema import MetricValue
from .reporter import complain, console, say, say_aside, show

PAGE = "report.html"

WIDTH = 120
"""Characters that the end of a run takes at most, on a wider terminal, too."""


def write_and_show(store: Store, sweep: Sweep, shown: Shown = EVERYTHING, width: int | None = None) -> None:
    """Rebuild the summary and the reports of a run, and print findings, table, unresolved differences and files to
    open, in lines of ``width`` characters (default: as many as the terminal has). Into a file or a pipe the table goes
    as Markdown."""
    summary, written = write(store, sweep, shown)
    table = suite_table(summary)
    room = min(WIDTH, console(width).width)
    conditions = f"{preset_and_recipe(summary)}; protocol {protocol_title(summary)}"
    for each in (*table.headline, f"{summary['title']}. Mean over {mean_over(summary)}; {conditions}."):
        say(*wrap(each, room))
    for part in parts_of(table, room if width is not None or sys.stdout.isatty() else math.inf):
        show(part, width)
    for each in (*below(table), *in_the_record(summary)):
        say(*wrap(each, room))
    if (compared := beside_report(summary)) is not None:
        say(*compared.sentences)
    say_aside(store)
    say(
        f"Open {store.folder / PAGE}: intervals, the paper's values, pictures, conditions ({len(written)} files there)."
    )


def below(table: Table) -> list[str]:
    """The lines below a table: how to read it, resolvable differences, and reasons for missing and doubtful values."""
    columns, lines = table.columns, []
    if table.reference and any(cell.difference is not None for cell in table.cells):
        lines.append(f"Differences: to '{table.reference.text}', ± half of the 95 % interval; * resolved.")
    if marked := [
        each.label for place, each in enumerate(columns) if any(row.cells[place].marks for row in table.rows)
    ]:
        lines.append(f"{MARKS[0]} doubtful, the page tells why: {', '.join(marked)}.")
    lines = [" ".join(lines)] if lines else []
    if apart := sorted({each.published_by for each in columns} - {""}):
        own = f"a run with --protocol {apart[0]} has them beside its own"
        lines.append(f"The paper's values are on other data and by protocol {', '.join(apart)}: {own}.")
    if told := [each for each in columns if each.smallest is not None]:
        smallest = (f"{each.label} {number(each.smallest or 0.0, each.decimals)} {each.unit}".rstrip() for each in told)
        lines.append(f"The median row resolves differences from about: {', '.join(smallest)}.")
    return [*lines, *(f"n/a in {', '.join(labels)}: {reason}" for reason, labels in table.missing.items())]


def in_the_record(summary: Summary) -> list[str]:
    """A sentence for each committed record of these rows by the same recipe: how many differences agree with it."""
    recipe, known = summary.get("recipe", ""), zip(summary.get("longer_runs", []), record_reports(summary), strict=True)
    return [report.agreement for run, report in known if run["recipe"] == recipe and report.agreement]


LABEL = 24
"""Most characters in a line of a row's label; longer labels are wrapped, and nothing else is."""


Texts = tuple[str, list[str]]
"""The heading of a column, and its text in each row."""


def parts_of(table: Table, width: float) -> list[RichTable]:
    """A table, cut between columns where ``width`` characters do not hold it."""
    label: Texts = table.lead, [row.text for row in table.rows]
    columns = [
        (heading(column), [entry(row.cells[place]) for row in table.rows]) for place, column in enumerate(table.columns)
    ]
    parts = []
    room = width - min(LABEL, lines_of(label)) - 2
    while columns:
        count = next((n for n in range(len(columns), 1, -1) if needed(columns[:n]) <= room), 1)
        parts.append(table_part(label, columns[:count]))
        columns = columns[count:]
    return parts


def needed(columns: Sequence[Texts]) -> int:
    """Characters that columns take when nothing is wrapped, each with the blank beside it."""
    return sum(lines_of(column) + 1 for column in columns)


def lines_of(column: Texts) -> int:
    """Characters of the longest line of a column."""
    heading, entries = column
    return max(cell_len(line) for text in (heading, *entries) for line in text.split("\n"))


def table_part(label: Texts, columns: Sequence[Texts]) -> RichTable:
    """A table of the rows' labels and some columns; only the labels may be wrapped."""
    made = RichTable(box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    made.add_column(label[0], max_width=LABEL)
    for heading, _ in columns:
        made.add_column(heading, no_wrap=True, justify="right")
    for place, text in enumerate(label[1]):
        made.add_row(escape(text), *(entries[place] for _, entries in columns))
    return made


def heading(column: Column) -> str:
    """A column's label in two lines, with the better direction and its unit."""
    task, _, measure = column.label.partition(" ")
    return "\n".join([*([task] if measure else []), f"{measure or task} {column.arrow} {column.unit}".rstrip()])


def entry(cell: PrintedCell) -> str:
    """Mean with its mark, paired difference with its interval and a star where it is resolved, and published value."""
    lines = [f"{cell.text}{cell.marks[:1] and MARKS[0]}"]
    if cell.difference is not None:
        lines.append(f"{cell.difference.plus_minus.replace(' ', '')}{'*' if cell.verdict else ''}")
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
