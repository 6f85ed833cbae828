"""The cost report as Markdown, LaTeX and CSV."""

from collections.abc import Iterator

import pandas as pd

from ..analysis.cost import CostReport
from ..analysis.cost.efficiency import efficiencies
from ..analysis.cost.marginal import doublings, steps
from ..analysis.pareto import points
from ..analysis.samples import COSTS
from ..statistics import Estimate
from ..summary import Summary, reference_of
from .caption import run_note
from .document import itemized
from .grid import grid_latex, grid_markdown

TITLE = "What each knob gives and takes"


def cost_markdown(summary: Summary, report: CostReport) -> str:
    """Sentences, then the grids."""
    title = TITLE[0].lower() + TITLE[1:]
    lines = [f"# {summary['title']}: {title}", "", *(f"- {each}" for each in report.sentences)]
    for grid in report.grids:
        lines += ["", *grid_markdown(grid)]
    return "\n".join([*lines, "", run_note(summary), ""])


def cost_latex(summary: Summary, report: CostReport) -> str:
    """Sentences, then the grids, to be input into a document with ``latex.PREAMBLE``."""
    lines = itemized(summary, TITLE, report.sentences)
    return "\n".join([*lines, *(table for grid in report.grids for table in grid_latex(grid)), ""])


def cost_csv(summary: Summary, report: CostReport) -> str:
    """One record per value: every point, step, slope and efficiency, with the ends of its interval."""
    records = [*_points(summary), *_steps(summary, report)]
    for doubling in doublings(summary, report.knobs):
        field, column = doubling.knob.field, doubling.column["key"]
        records.append(_record("slope per doubling", field, "", column, doubling.slope))
    for each in efficiencies(summary):
        records.append(_record("efficiency", each.row, reference_of(summary), each.column["key"], each.ratio))
    return pd.DataFrame.from_records(records).to_csv(index=False)


def _points(summary: Summary) -> Iterator[dict[str, object]]:
    """Cost and value of every point; means of a row have no interval of their own."""
    for column in summary["columns"]:
        for cost in COSTS:
            for point in points(summary, column, cost):
                place = "on the front" if point.on_front else "beaten"
                count = summary["cells"][point.row][column["key"]]["count"]
                mean_cost, quality = (Estimate(mean, None, None, count) for mean in (point.cost, point.quality))
                yield _record(f"point, {cost}", point.row, place, column["key"], mean_cost)
                yield _record("point, value", point.row, cost, column["key"], quality)


def _steps(summary: Summary, report: CostReport) -> Iterator[dict[str, object]]:
    for step in steps(summary, report.knobs):
        what = f"step of {step.knob.field}"
        for column, change in step.differences.items():
            yield _record(what, step.high.row, step.low.row, column, change)
        for cost, ratio in (("seconds", step.time_ratio), ("rays", step.ray_ratio)):
            if ratio is not None:
                yield _record(f"{what}, ratio", step.high.row, step.low.row, cost, ratio)


def _record(what: str, row: str, versus: str, column: str, value: Estimate) -> dict[str, object]:
    return {
        "what": what, "row": row, "versus": versus, "column": column, "value": value.mean, "low": value.low,
        "high": value.high, "count": value.count,
    }  # fmt: skip
