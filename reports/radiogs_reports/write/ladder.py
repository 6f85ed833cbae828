"""The oracle ladder as Markdown, LaTeX and CSV."""

import pandas as pd

from ..analysis.ladder import LadderReport
from ..summary import Summary
from .caption import run_note
from .document import itemized
from .grid import grid_latex, grid_markdown
from .records import estimate_fields


def ladder_markdown(summary: Summary, report: LadderReport) -> str:
    """Sentences, then the table."""
    lines = [f"# {summary['title']}: the oracle ladder", "", *(f"- {each}" for each in report.sentences), ""]
    return "\n".join([*lines, *grid_markdown(report.grid), "", run_note(summary), ""])


def ladder_latex(summary: Summary, report: LadderReport) -> str:
    """Sentences, then the table, to be input into a document with ``latex.PREAMBLE``."""
    lines = itemized(summary, "The oracle ladder", report.sentences)
    return "\n".join([*lines, *grid_latex(report.grid), ""])


def ladder_csv(report: LadderReport) -> str:
    """One record per method, scene, metric and part: values and gains with the ends of their intervals."""
    records = []
    for rung in report.rungs:
        for part, share in rung.parts.items():
            estimates = {
                "nothing_given": rung.nothing, "first_in": share.first_in, "last_out": share.last_out,
                "everything_given": rung.everything,
            }  # fmt: skip
            records.append(
                {"method": rung.method, "scene": rung.scene, "metric": rung.column["key"], "part": part}
                | {key: value for name, each in estimates.items() for key, value in estimate_fields(name, each).items()}
            )
    return pd.DataFrame.from_records(records).to_csv(index=False)
