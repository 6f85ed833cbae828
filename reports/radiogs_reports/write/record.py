"""Records as Markdown: below the table of a run, as a document of their own, and as a page with one table."""

from collections.abc import Iterator, Sequence

from ..analysis.report import Grid, name_item
from ..summary import RecordedRun, Summary
from ..tables.model import PrintedCell
from ..tables.record import HEADING, RecordReport, claims, record_report, record_reports, recorded_table
from ..wording import mean_over
from .analyses import grid_markdown
from .markdown import listed, table_head, table_line, without_markup
from .suite import means_markdown


def below_a_run(summary: Summary) -> str:
    """The record of the suite below the table of a run, with a sentence for each row and column; empty without one."""
    found = record_reports(summary)
    if not found:
        return ""
    lines = ["", f"## {HEADING}"]
    for report in found:
        lines += ["", *_shown(report), *(f"- {each.sentence}" for each in report.agreements)]
    return "\n".join([*lines, ""])


def record_document(runs: Sequence[RecordedRun]) -> str:
    """A record as a document: the paper's claims, and of each run its origin, tables and differences by scene."""
    lines = [
        f"# {HEADING}",
        "",
        "Written by `radiogs-bench record` from the sealed record; the same record gives it anew.",
    ]
    if (claimed := claims(runs)) is not None:
        lines += ["", *grid_markdown(claimed)]
    for number, run in enumerate(runs):
        report = record_report(run, f"record-{number}")
        lines += ["", f"## {report.title}", "", *_shown(report)]
        for found in run.get("analyses", []):
            rows = [[name_item(text) for text in line] for line in found["lines"]]
            grid = Grid("recorded", found["title"], found["note"], found["heads"], rows)
            lines += [*grid_markdown(grid), "", *(f"- {each}" for each in found["sentences"]), ""]
        lines += grid_markdown(report.by_scene)
    return without_markup("\n".join([*lines, ""]))


def _shown(report: RecordReport) -> Iterator[str]:
    """Origin, findings, table and legend of a recorded run."""
    for heading, text in report.facts.items():
        yield f"- {heading}: `{text}`" if heading == "Command" else f"- {heading}: {text}"
    yield from ["", *listed([each.plain for each in report.table.findings]), *means_markdown(report.table), ""]
    for sentence in report.table.legend_in_words:
        yield from (sentence, "")


def record_page(runs: Sequence[RecordedRun]) -> str:
    """A record as a page with one table, the means of all of its runs, below their origin."""
    lines = [f"# {HEADING}", "", f"{runs[0]['title']}, by metric protocol {runs[0]['protocol']}. {READ_MEANS}", ""]
    tables = [recorded_table(run, "record") for run in runs]
    for number, run in enumerate(runs, start=1):
        origin = ", ".join(run["origin"].get(name, "") for name in ("Date", "Commit"))
        recipe = "recipes by row" if " by " in run["recipe"] else run["recipe"] or "default"
        lines.append(
            f"{number}. {origin}, {run['machine']}, {recipe}; mean over {mean_over(run, named=False)}:"
            f" `{run['origin']['Command']}`"
        )
    rows = table_head(["run", "", *(column.heading for column in tables[0].columns)])
    for number, table in enumerate(tables, start=1):
        rows += [table_line([str(number), row.text, *map(_mean, row.cells)]) for row in table.rows]
    narrow = [row.replace(" | ", "|") for row in rows]
    return without_markup("\n".join([*lines, "", *narrow, ""]))


READ_MEANS = (
    "Means; bold where the difference to the reference row of the run is resolved to be better, italic where to be"
    " worse. Intervals, analyses and the values of each scene are on the site (`make site`)."
)


def _mean(cell: PrintedCell) -> str:
    mark = {"better": "**", "worse": "*", None: ""}[cell.verdict]
    return f"{mark}{cell.text}{mark}"
