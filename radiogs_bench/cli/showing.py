"""Writes a store's summary and reports, and prints its table."""

from pathlib import Path

from rich.table import Table

from radiogs_baselines.published import published
from radiogs_reports import write_reports
from radiogs_reports.doubts import footnotes, marks, remarks
from radiogs_reports.summary import CellSummary, ColumnSummary, Summary

from ..results.summary import summarise
from ..store.atomic import explained, write_atomically
from ..store.folder import Store
from ..store.seal import sealed, strict_json
from ..suites.sweep import Sweep
from .aside import say_aside
from .reporter import say, show


def write_and_show(store: Store, sweep: Sweep) -> None:
    """Rebuild the summary and the reports of a run, print the table, and say where they are."""
    summary, written = write(store, sweep)
    show(table_of(summary))
    say(explanation(summary))
    for sentence in (*reasons(summary), *footnotes(summary), *remarks(summary)):
        say(sentence)
    say(f"Metric protocol: {summary['protocol']}. Published values: {summary['published_data']}.")
    for path in written:
        say(f"wrote {path}")
    say_aside(store)


def write(store: Store, sweep: Sweep) -> tuple[Summary, list[Path]]:
    """Rebuild the summary and the reports of a run, given by its manifest; returns the summary and all files."""
    table = published(sweep["published"]) if sweep["published"] else None
    summary = summarise(store, sweep, table.figures if table else {}, table.data if table else "none for this suite")
    with store.patient_claim("summary"):
        write_atomically(store.folder / "summary.json", strict_json(sealed(summary)))
        with explained(store.folder):
            written = write_reports(store.folder)
    return summary, [store.folder / "summary.json", *written]


def table_of(summary: Summary) -> Table:
    """The suite's table, with published values below measured ones."""
    seeds = ", ".join(map(str, summary["seeds"]))
    title = f"{summary['title']}: {', '.join(summary['scenes'])}, seeds {seeds}, preset {summary['preset']}"
    table = Table("", *(heading(column) for column in summary["columns"]), "seconds", title=title, show_lines=True)
    for row in summary["rows"]:
        entries = [
            entry(
                summary["cells"][row["key"]][column["key"]],
                summary["published"].get(row["key"], {}),
                column,
                marks(summary, row["key"], column["key"]),
            )
            for column in summary["columns"]
        ]
        seconds = "" if row["seconds"] is None else f"{row['seconds']:.1f}"
        table.add_row(row["text"], *entries, seconds)
    return table


def explanation(summary: Summary) -> str:
    """A sentence that explains what is below each value in the table."""
    if summary["reference"] is None:
        return "The rows are not variants of one method, so no differences are shown."
    pairs = max(cell["count"] for row in summary["cells"].values() for cell in row.values())
    below = f"Below each value: its difference to '{summary['reference']}'"
    if pairs <= 1:
        return f"{below}; a single run has no interval (use --seeds 2 or more)."
    return f"{below}, paired over {pairs} (scene, seed), with its 95 % t interval."


def reasons(summary: Summary) -> list[str]:
    """Why values are missing: each reason once, with its columns."""
    columns: dict[str, list[str]] = {}
    for column in summary["columns"]:
        for row in summary["rows"]:
            reason = summary["cells"][row["key"]][column["key"]]["reason"]
            if reason is not None and column["label"] not in columns.setdefault(reason, []):
                columns[reason].append(column["label"])
    return [f"missing in {', '.join(labels)}: {reason}" for reason, labels in columns.items()]


def heading(column: ColumnSummary) -> str:
    """A column's heading with its unit and the better direction."""
    arrow = {"up": "↑", "down": "↓", "zero": "→ 0"}[column["direction"]]
    return f"{column['label']} {arrow}" + (f" [{column['unit']}]" if column["unit"] else "").replace("[", r"\[")


def entry(cell: CellSummary, published_row: dict[str, float], column: ColumnSummary, mark: str = "") -> str:
    """Mean with its marks, paired difference with its interval, and published value, each on a line."""
    digits = column["decimals"]
    lines = ["n/a" if cell["mean"] is None else f"{cell['mean']:.{digits}f}{mark}"]
    difference = cell["difference"]
    if difference is not None and difference["low"] is not None and difference["high"] is not None:
        half_width = (difference["high"] - difference["low"]) / 2
        lines.append(f"{difference['mean']:+.{digits}f} ± {half_width:.{digits}f}")
    elif difference is not None:
        lines.append(f"{difference['mean']:+.{digits}f}")
    if column["key"] in published_row:
        lines.append(f"paper {published_row[column['key']]:.{digits}f}")
    return "\n".join(lines)
