"""The table as Markdown and as CSV."""

import pandas as pd

from ..summary import CellSummary, ColumnSummary, Summary

ARROWS = {"up": "↑", "down": "↓", "zero": "→ 0"}


def heading(column: ColumnSummary) -> str:
    """Heading with the better direction and the unit."""
    unit = f" ({column['unit']})" if column["unit"] else ""
    return f"{column['label']} {ARROWS[column['direction']]}{unit}"


def signed_figure(value: float, decimals: int) -> str:
    """A difference with its sign, which what rounds to nothing has not."""
    text = f"{value:+.{decimals}f}"
    return text if float(text) else text[1:]


def measured(cell: CellSummary, decimals: int) -> str:
    """Mean, and the paired difference with its interval."""
    if cell["mean"] is None:
        return f"n/a ({cell['reason']})"
    text = f"{cell['mean']:.{decimals}f}"
    difference = cell["difference"]
    if difference is None:
        return text
    if difference["low"] is None or difference["high"] is None:
        return f"{text} ({signed_figure(difference['mean'], decimals)})"
    middle, low, high = (
        signed_figure(end, decimals) for end in (difference["mean"], difference["low"], difference["high"])
    )
    return f"{text} ({middle}, {low} to {high})"


def markdown(summary: Summary) -> str:
    """A Markdown table: measured figures, and the published ones in columns of their own."""
    published = [column for column in summary["columns"] if _is_published(summary, column)]
    heads = ["", *map(heading, summary["columns"]), *(f"paper: {heading(column)}" for column in published), "s"]
    lines = [f"# {summary['title']}", "", row_of(heads), row_of(["---"] * len(heads))]
    for row in summary["rows"]:
        figures = [measured(summary["cells"][row["key"]][c["key"]], c["decimals"]) for c in summary["columns"]]
        beside = [
            f"{value:.{c['decimals']}f}" if (value := summary["published"].get(row["key"], {}).get(c["key"])) else ""
            for c in published
        ]
        seconds = "" if row["seconds"] is None else f"{row['seconds']:.0f}"
        lines.append(row_of([row["text"], *figures, *beside, seconds]))
    return "\n".join([*lines, "", note(summary), ""])


def note(summary: Summary) -> str:
    """What the figures are, in a sentence each."""
    differences = (
        f" In brackets: paired difference to '{_text(summary, summary['reference'])}', with its 95 % t interval."
        if summary["reference"] is not None
        else ""
    )
    return (
        f"Mean over {count_of(len(summary['scenes']), 'scene')} ({', '.join(summary['scenes'])}) and"
        f" {count_of(len(summary['seeds']), 'seed')}; preset {summary['preset']}; metric protocol"
        f" {summary['protocol']}.{unfinished(summary)}{differences} Published figures: {summary['published_data']}."
        f" Machine: {summary['machine']}."
    )


def unfinished(summary: Summary) -> str:
    """A sentence where the means are over fewer cells than the run is to have."""
    finished = sum(run["state"] == "finished" for run in summary["runs"])
    return "" if finished == len(summary["runs"]) else f" {finished} of {len(summary['runs'])} cells are finished."


def csv(summary: Summary) -> str:
    """One line a figure: row, column, mean, count, difference, interval, published figure, reason."""
    records = []
    for row in summary["rows"]:
        for column in summary["columns"]:
            cell = summary["cells"][row["key"]][column["key"]]
            difference = cell["difference"] or {"mean": None, "low": None, "high": None}
            records.append(
                {
                    "row": row["key"],
                    "column": column["key"],
                    "unit": column["unit"],
                    "direction": column["direction"],
                    "mean": cell["mean"],
                    "count": cell["count"],
                    "difference": difference["mean"],
                    "difference_low": difference["low"],
                    "difference_high": difference["high"],
                    "published": summary["published"].get(row["key"], {}).get(column["key"]),
                    "reason": cell["reason"],
                }
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _is_published(summary: Summary, column: ColumnSummary) -> bool:
    return any(column["key"] in row for row in summary["published"].values())


def row_of(cells: list[str]) -> str:
    """A line of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def count_of(number: int, noun: str) -> str:
    """Such as ``2 seeds``."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _text(summary: Summary, key: str) -> str:
    return next(row["text"] for row in summary["rows"] if row["key"] == key)
