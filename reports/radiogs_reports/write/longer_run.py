"""Records of longer runs as Markdown: below the table of a run, and as a document of their own."""

from collections.abc import Iterator, Sequence

from ..summary import LongerRun, Summary
from ..tables.longer_run import HEADING, LongerReport, claims, grid_of, longer_report, longer_reports
from .analyses import grid_markdown
from .markdown import listed, without_markup
from .suite import means_markdown


def below_a_run(summary: Summary) -> str:
    """The record of the suite below the table of a run, with a sentence for each row and column; empty without one."""
    found = longer_reports(summary)
    if not found:
        return ""
    lines = ["", f"## {HEADING}"]
    for report in found:
        lines += ["", *_shown(report), *_legend(report)]
        lines += [f"- {each.sentence}" for each in report.agreements]
    return "\n".join([*lines, ""])


def record_document(runs: Sequence[LongerRun]) -> str:
    """A record as a document: the paper's claims, and of each run its origin, tables and differences by scene."""
    lines = [
        f"# {HEADING}",
        "",
        "Written by `radiogs-bench record` from the sealed record; the same record gives it anew.",
    ]
    if (claimed := claims(runs)) is not None:
        lines += ["", *grid_markdown(claimed)]
    for number, run in enumerate(runs):
        report = longer_report(run, f"record-{number}")
        lines += ["", f"## {report.title}", "", *_shown(report), *_legend(report)]
        for found in run.get("analyses", []):
            lines += [*grid_markdown(grid_of(found)), "", *(f"- {each}" for each in found["sentences"]), ""]
        lines += grid_markdown(report.by_scene)
    return without_markup("\n".join([*lines, ""]))


def _shown(report: LongerReport) -> list[str]:
    """Origin, findings and table of a longer run."""
    found = listed([each.plain for each in report.table.findings])
    return [*_facts(report), "", *found, *means_markdown(report.table), ""]


def _facts(report: LongerReport) -> Iterator[str]:
    for heading, text in report.facts.items():
        yield f"- {heading}: `{text}`" if heading == "Command" else f"- {heading}: {text}"


def _legend(report: LongerReport) -> Iterator[str]:
    for sentence in report.table.legend_in_words:
        yield from (sentence, "")
