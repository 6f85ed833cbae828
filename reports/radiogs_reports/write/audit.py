"""The audit as Markdown, LaTeX and CSV."""

import pandas as pd

from ..analysis.audit.report import AuditReport
from ..analysis.paired import Estimate
from ..summary import Summary
from .grid import grid_latex, grid_markdown
from .latex import as_formula
from .plain import note


def audit_markdown(summary: Summary, report: AuditReport) -> str:
    """Sentences, then the table."""
    lines = [f"# {summary['title']}: the audit", "", *(f"- {each}" for each in report.sentences), ""]
    return "\n".join([*lines, *grid_markdown(report.grid), "", note(summary), ""])


def audit_latex(summary: Summary, report: AuditReport) -> str:
    """The same, to be input into a document with the preamble of ``latex``."""
    lines = [
        f"% {as_formula(summary['title'])}: made by radiogs-bench from the results {', '.join(summary['keys'])}",
        r"\section*{The audit of plans}",
        r"\begin{itemize}",
        *(rf"\item {as_formula(each)}" for each in report.sentences),
        r"\end{itemize}",
    ]
    return "\n".join([*lines, *grid_latex(report.grid), ""])


def audit_csv(report: AuditReport) -> str:
    """One line a scene and row; figures with the ends of their intervals, shares between 0 and 1."""
    records = []
    for line in report.lines:
        estimates = {f"{name}_loss": loss for name, loss in line.losses.items()} | {
            "rays_saved": line.rays, "stage2_times_as_fast": line.stage2, "training_times_as_fast": line.training,
            "probes_of_stage2": line.probes_of_stage2, "probes_of_training": line.probes_of_training,
            "probe_rays_share": line.probe_rays,
        }  # fmt: skip
        records.append(
            {"scene": line.scene, "row": line.row, "seeds": line.seeds, "bound": line.bound,
             "tolerance": line.tolerance, "under_bound": line.judgement, "left_out": line.left_out}
            | {key: value for name, each in estimates.items() for key, value in _ends(name, each).items()}
        )  # fmt: skip
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _ends(name: str, value: Estimate | None) -> dict[str, float | None]:
    if value is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None}
    return {name: value.mean, f"{name}_low": value.low, f"{name}_high": value.high}
