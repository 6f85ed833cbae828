"""Findings of the analyses of a run as Markdown, LaTeX and CSV: sentences, grids of derived values, and records."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Protocol

from ..analysis.audit import AuditReport
from ..analysis.beside import BesideReport
from ..analysis.chain import ChainReport
from ..analysis.cost import CostReport
from ..analysis.cost_knobs import doublings, steps
from ..analysis.crossed import CrossedReport
from ..analysis.efficiency import efficiencies
from ..analysis.grid import Grid
from ..analysis.ladder import LadderReport
from ..analysis.pareto import points
from ..analysis.published_order import OrderReport
from ..analysis.samples import COSTS
from ..statistics import Estimate
from ..summary import Summary, reference_of
from ..tables.caption import run_note
from .document import itemized
from .latex import BOX_BEGIN, BOX_END, as_formula
from .markdown import table_head, table_line
from .records import csv_of, estimate_fields


class Findings(Protocol):
    """The findings of an analysis in sentences, and the grid that shows them."""

    @property
    def sentences(self) -> Sequence[str]:
        """The findings, a sentence each."""

    @property
    def grid(self) -> Grid:
        """The values that the sentences are about."""


def findings_markdown(summary: Summary, title: str, found: Findings) -> str:
    """Sentences, then the table."""
    lines = [f"# {summary['title']}: {title}", "", *(f"- {each}" for each in found.sentences), ""]
    return "\n".join([*lines, *grid_markdown(found.grid), "", run_note(summary), ""])


def findings_latex(summary: Summary, title: str, found: Findings) -> str:
    """Sentences, then the table, to be input into a document with ``latex.PREAMBLE``."""
    lines = itemized(summary, f"{title[:1].upper()}{title[1:]}", found.sentences)
    return "\n".join([*lines, *grid_latex(found.grid), ""])


COST_TITLE = "What each knob gives and takes"


def cost_markdown(summary: Summary, report: CostReport) -> str:
    """Sentences, then the grids."""
    title = COST_TITLE[0].lower() + COST_TITLE[1:]
    lines = [f"# {summary['title']}: {title}", "", *(f"- {each}" for each in report.sentences)]
    for grid in report.grids:
        lines += ["", *grid_markdown(grid)]
    return "\n".join([*lines, "", run_note(summary), ""])


def cost_latex(summary: Summary, report: CostReport) -> str:
    """Sentences, then the grids, to be input into a document with ``latex.PREAMBLE``."""
    lines = itemized(summary, COST_TITLE, report.sentences)
    return "\n".join([*lines, *(table for grid in report.grids for table in grid_latex(grid)), ""])


def cost_csv(summary: Summary, report: CostReport) -> str:
    """One record per value: every point, step, slope and efficiency, with the ends of its interval."""
    records = [*_points(summary), *_steps(summary, report)]
    for doubling in doublings(summary, report.knobs):
        field, column = doubling.knob.field, doubling.column["key"]
        records.append(_record("slope per doubling", field, "", column, doubling.slope))
    for each in efficiencies(summary):
        records.append(_record("efficiency", each.row, reference_of(summary), each.column["key"], each.ratio))
    return csv_of(records)


def _points(summary: Summary) -> Iterator[dict[str, object]]:
    """Cost and value of every point; means of a row have no interval of their own."""
    for column in summary["columns"]:
        for cost in COSTS:
            for point in points(summary, column, cost):
                place = "on the front" if point.on_front else "beaten"
                count = summary["cells"][point.row][column["key"]]["count"]
                mean_cost, quality = (
                    Estimate(mean, None, None, 1, values=count) for mean in (point.cost, point.quality)
                )
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
        "high": value.high, "over": value.over, "units": value.units, "count": value.values,
    }  # fmt: skip


def audit_csv(report: AuditReport) -> str:
    """One record per scene and row: estimates with the ends of their intervals, shares between 0 and 1."""
    records = []
    for line in report.lines:
        estimates = {f"{name}_loss": loss for name, loss in line.losses.items()} | {
            "rays_saved": line.rays_saved, "last_stage_times_as_fast": line.last_stage,
            "training_times_as_fast": line.training, "probes_of_last_stage": line.probes_of_last_stage,
            "probes_of_training": line.probes_of_training, "probe_rays_share": line.probe_rays,
        }  # fmt: skip
        records.append(
            {"scene": line.scene, "row": line.row, "seeds": line.seeds, "bound": line.bound,
             "tolerance": line.tolerance, "under_bound": line.judgement, "left_out": line.left_out}
            | {key: value for name, each in estimates.items() for key, value in estimate_fields(name, each).items()}
        )  # fmt: skip
    return csv_of(records)


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
    return csv_of(records)


def chain_csv(report: ChainReport) -> str:
    """One record per metric and step: the difference to the row before with the ends of its interval."""
    records = [
        {"metric": worth.column["key"], "row": row, "after": before} | estimate_fields("difference", worth.steps[row])
        for worth in report.worth
        for before, row in pairwise(report.rows)
    ]
    return csv_of(records)


def crossed_csv(report: CrossedReport) -> str:
    """One record per pair of rows and metric: the difference with the ends of its interval."""
    records: list[dict[str, object]] = []
    for each in report.found:
        for (one, other, column), difference in report.differences.items():
            if (one, other) in each.pairs:
                named: dict[str, object] = {"setting": each.setting, "row": one, "instead_of": other, "metric": column}
                records.append(named | estimate_fields("difference", difference))
    return csv_of(records)


def beside_csv(report: BesideReport) -> str:
    """One record per row and metric: both means, the difference with the ends of its interval, and the verdict."""
    records: list[dict[str, object]] = []
    for each in report.values:
        named: dict[str, object] = {"row": each.row, "metric": each.column["key"]}
        estimates = {"there": each.there, "here": each.here, "difference": each.difference}
        for name, estimate in estimates.items():
            named |= estimate_fields(name, estimate)
        records.append(named | {"verdict": each.verdict, "equal": each.equal})
    return csv_of(records)


def order_csv(report: OrderReport) -> str:
    """One record per column: tau with its bounds, and the pairs of rows that are resolved in either order."""
    records = [
        {
            "column": order.column["key"], "methods": order.methods, "tau": order.tau, "tau_low": order.low,
            "tau_high": order.high, "by_chance": order.by_chance, "confirmed": order.confirmed,
            "reversed": "; ".join(f"{each.better} > {each.worse}" for each in order.reversals) or None,
        }
        for order in report.orders
    ]  # fmt: skip
    return csv_of(records)


def settling_csv(summary: Summary) -> str:
    """One record for each row and column: mean seconds, the ends of the interval, and over how many runs."""
    records = [
        {"row": row, "column": column, **settled}
        for row, columns in summary.get("settling", {}).items()
        for column, settled in columns.items()
    ]
    return csv_of(records)


ROWS_PER_PAGE = 32


def grid_markdown(grid: Grid) -> list[str]:
    """Title, note and table, as lines."""
    lines = [f"## {grid.title}", "", grid.note, "", *table_head(grid.heads)]
    return [*lines, *(table_line([item.text for item in row]) for row in grid.rows)]


def grid_latex(grid: Grid) -> list[str]:
    """Table environments, one per page that the grid needs."""
    pages = [grid.rows[start : start + ROWS_PER_PAGE] for start in range(0, len(grid.rows), ROWS_PER_PAGE)]
    first, *others = (grid._replace(rows=rows) for rows in pages)
    return [
        _table(first, f"{grid.title}. {grid.note}", f"\\label{{grid:{grid.name}}}"),
        *(_table(page, f"{grid.title}, continued.", "") for page in others),
    ]


def _table(grid: Grid, caption: str, label: str) -> str:
    lines = [
        r"\begin{table}[tbp]",
        r"\centering",
        f"\\caption{{{as_formula(caption)}}}{label}",
        BOX_BEGIN,
        f"\\begin{{tabular}}{{{'l' * len(grid.heads)}}}",
        r"\toprule",
        f"{' & '.join(map(as_formula, grid.heads))} \\\\",
        r"\midrule",
        *(f"{' & '.join(as_formula(item.text) for item in row)} \\\\" for row in grid.rows),
        r"\bottomrule",
        r"\end{tabular}}",
        BOX_END,
        r"\end{table}",
    ]
    return "\n".join(lines)
