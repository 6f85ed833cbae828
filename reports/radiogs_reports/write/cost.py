"""The report of what accuracy costs as Markdown, LaTeX and CSV."""

import pandas as pd

from ..analysis.cost.efficiency import efficiencies
from ..analysis.cost.marginal import doublings, steps
from ..analysis.cost.report import CostReport
from ..analysis.paired import Estimate
from ..analysis.pareto import COSTS, points
from ..summary import Summary, reference_of
from .grid import grid_latex, grid_markdown
from .latex import as_formula
from .plain import note


def cost_markdown(summary: Summary, report: CostReport) -> str:
    """Sentences, then the grids."""
    lines = [f"# {summary['title']}: what each knob gives and takes", "", *(f"- {each}" for each in report.sentences)]
    for grid in report.grids:
        lines += ["", *grid_markdown(grid)]
    return "\n".join([*lines, "", note(summary), ""])


def cost_latex(summary: Summary, report: CostReport) -> str:
    """The same, to be input into a document with the preamble of ``latex``."""
    lines = [
        f"% {as_formula(summary['title'])}: made by radiogs-bench from the results {', '.join(summary['keys'])}",
        r"\section*{What each knob gives and takes}",
        r"\begin{itemize}",
        *(rf"\item {as_formula(each)}" for each in report.sentences),
        r"\end{itemize}",
    ]
    return "\n".join([*lines, *(table for grid in report.grids for table in grid_latex(grid)), ""])


def cost_csv(summary: Summary, report: CostReport) -> str:
    """One line a figure: every point of every front, step, slope and efficiency, with the ends of its interval."""
    records = []

    def record(what: str, row: str, versus: str, column: str, value: Estimate) -> None:
        records.append(
            {"what": what, "row": row, "versus": versus, "column": column, "value": value.mean, "low": value.low,
             "high": value.high, "count": value.count}
        )  # fmt: skip

    for column in summary["columns"]:
        for cost in COSTS:
            for point in points(summary, column, cost):
                where = "on the front" if point.on_front else "beaten"
                count = summary["cells"][point.row][column["key"]]["count"]
                record(f"point, {cost}", point.row, where, column["key"], Estimate(point.cost, None, None, count))
                record("point, figure", point.row, cost, column["key"], Estimate(point.quality, None, None, count))
    for step in steps(summary, report.knobs):
        for key, each in step.differences.items():
            record(f"step of {step.knob.field}", step.high.row, step.low.row, key, each)
        for cost, ratio in (("seconds", step.times), ("rays", step.rays)):
            if ratio is not None:
                record(f"step of {step.knob.field}, ratio", step.high.row, step.low.row, cost, ratio)
    for doubling in doublings(summary, report.knobs):
        record("slope per doubling", doubling.knob.field, "", doubling.column["key"], doubling.slope)
    for row in efficiencies(summary):
        record("efficiency", row.row, reference_of(summary), row.column["key"], row.times)
    return pd.DataFrame.from_records(records).to_csv(index=False)
