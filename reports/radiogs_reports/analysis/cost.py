"""The cost of accuracy: sentences and grids for every form of the report, computed from a run's summary alone."""

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

from ..statistics import Estimate
from ..summary import ColumnSummary, ErrorParts, Summary, last_stage_title, reference_of, row_texts
from ..wording import label_with_unit, mean_over, plus_minus, population_of, signed
from .cost_knobs import Doubling, Knob, Step, doublings, knobs, steps
from .cost_progress import at_equal_time, second_half, to_equal_quality
from .efficiency import efficiencies
from .grid import Grid, Item, estimate_item, factor_item, name_item
from .pareto import points
from .samples import COSTS

PARTED: Mapping[str, str] = {
    "image": "new views", "albedo": "albedo", "indirect": "indirect light", "relit": "relit views",
}  # fmt: skip
"""Kinds of images, by their name in the summary's ``error_parts``."""

UNSHARED = "no scene and seed has every setting"


class CostReport(NamedTuple):
    """The knobs of the run, with the gain and the cost of turning them, as sentences and as grids."""

    knobs: list[Knob]
    sentences: list[str]
    grids: list[Grid]


def cost_report(summary: Summary) -> CostReport | None:
    """The report of a run; None where no rows differ from the reference row in a single field of the budget."""
    turned = knobs(summary)
    if not turned:
        return None
    found = doublings(summary, turned)
    sentences = [step_sentence(summary, step) for step in steps(summary, turned) if step.differences]
    sentences += [doubling_sentence(list(each)) for _, each in groupby(found, key=lambda each: each.knob)]
    last = second_half_sentence(summary)
    grids = [
        _doublings(summary, turned, found),
        _fronts(summary),
        _efficiencies(summary),
        _times(summary),
        _qualities(summary),
        _error_parts(summary),
    ]
    parted = error_parts_sentence(summary)
    return CostReport(
        turned,
        [*sentences, *(each for each in (last, parted) if each is not None)],
        [grid for grid in grids if grid.rows],
    )


def step_sentence(summary: Summary, step: Step) -> str:
    """One step of a knob: ``rays a surfel, N_s, 64 → 128: NVS PSNR +0.03 ± 0.05 dB, for 1.90 times the time.``"""
    changes = [
        change(step.differences[column["key"]], column)
        for column in summary["columns"]
        if column["key"] in step.differences
    ]
    text = f"{step.knob.text}, {step.low.value} → {step.high.value}: {', '.join(changes)}"
    if step.time_ratio is not None:
        text += f", for {step.time_ratio.mean:.2f} times the time"
    if step.ray_ratio is not None:
        text += f" and {step.ray_ratio.mean:.2f} times the rays"
    return f"{text}."


def doubling_sentence(doublings: list[Doubling]) -> str:
    """The change of every column per doubling of a knob; all ``doublings`` belong to that knob."""
    first = doublings[0]
    changes = [change(each.slope, each.column) for each in doublings]
    cost = "" if first.time_ratio is None else f", for {first.time_ratio.mean:.2f} times the time"
    return f"Each doubling of {first.knob.text}: {', '.join(changes)}{cost}."


def second_half_sentence(summary: Summary) -> str | None:
    """The gain of the second half of the last stage; None where nothing was scored during training."""
    found = [(column, second_half(summary, column["key"])) for column in summary["columns"]]
    known = [(column, each) for column, each in found if each is not None]
    if not known:
        return None
    changes = ", ".join(change(gain, column) for column, (gain, _) in known)
    share = 100 * known[0][1][1].mean
    return f"The second half of {last_stage_title(summary)}: {changes}, for {share:.0f} % of the training time."


def error_parts_sentence(summary: Summary) -> str | None:
    """How much of the reference row's error differs between seeds; None where no scene has several."""
    parts = summary.get("error_parts", {}).get(reference_of(summary))
    if not parts:
        return None
    said = ", ".join(f"{PARTED[kind]} {variance_share(each):.0f} %" for kind, each in parts.items() if kind in PARTED)
    return (
        f"Variance between seeds is this share of the squared error of '{row_texts(summary)[reference_of(summary)]}':"
        f" {said}. The rest is the same for every seed."
    )


def variance_share(parts: ErrorParts) -> float:
    """Percentage of a squared error that is variance between seeds; 0 without an error."""
    return 100 * parts["variance"] / parts["error"] if parts["error"] > 0 else 0.0


def change(estimate: Estimate, column: ColumnSummary) -> str:
    """Label, signed difference, half-width of its interval if there is one, unit."""
    decimals = column["decimals"]
    text = plus_minus(signed(estimate.mean, decimals), estimate.half_width, decimals)
    return f"{column['label']} {text} {column['unit']}".rstrip()


def _doublings(summary: Summary, turned: list[Knob], found: Sequence[Doubling]) -> Grid:
    rows = []
    for knob in turned:
        mine = {each.column["key"]: each for each in found if each.knob == knob}
        time_ratio = next((each.time_ratio for each in mine.values()), None)
        slopes = [
            estimate_item(mine[column["key"]].slope if column["key"] in mine else None, column["decimals"], UNSHARED)
            for column in summary["columns"]
        ]
        values = ", ".join(str(setting.value) for setting in knob.settings)
        rows.append([name_item(knob.text), name_item(values), *slopes, factor_item(time_ratio, UNSHARED)])
    return Grid(
        "doublings",
        "What a doubling of each knob gives",
        "Least-squares slope over the knob's binary logarithm; half-width of the 95 % t interval"
        f" {population_of(summary)}.",
        ["knob", "settings", *map(label_with_unit, summary["columns"]), "time, times"],
        rows,
    )


def _fronts(summary: Summary) -> Grid:
    texts = row_texts(summary)
    rows = []
    for column in summary["columns"]:
        for cost, label in COSTS.items():
            for point in sorted(points(summary, column, cost), key=lambda each: each.cost):
                if point.on_front:
                    amount = f"{point.cost:.1f}" if cost == "seconds" else f"{point.cost / 1e6:.3f} million"
                    rows.append(
                        [
                            name_item(column["label"]),
                            name_item(label),
                            name_item(texts[point.row]),
                            Item(amount, point.cost),
                            Item(f"{point.quality:.{column['decimals']}f}", point.quality),
                        ]
                    )
    return Grid(
        "fronts",
        "Pareto fronts",
        "Rows that no other row beats in both metric and cost; the plots and the CSV hold all measured points.",
        ["metric", "cost", "row", "amount", "value"],
        rows,
    )


def _efficiencies(summary: Summary) -> Grid:
    found = {(each.row, each.column["key"]): each.ratio for each in efficiencies(summary)}
    columns = [column for column in summary["columns"] if any(key == column["key"] for _, key in found)]
    rows = []
    for row in summary["rows"]:
        ratios = [found.get((row["key"], column["key"])) for column in columns]
        if any(ratios):
            is_reference = row["key"] == reference_of(summary)
            rows.append(
                [name_item(row["text"]), *(Item("1", 1.0) if is_reference else factor_item(each) for each in ratios)]
            )
    return Grid(
        "efficiency",
        "Efficiency 1 / (MSE x seconds), times the reference's",
        f"Geometric mean with the ends of its 95 % interval {population_of(summary)}; above 1 is better than the"
        " reference.",
        ["row", *(column["label"] for column in columns)],
        rows,
    )


def _times(summary: Summary) -> Grid:
    texts = row_texts(summary)
    rows = [
        [
            name_item(each.column["label"]),
            Item(f"{each.seconds:.1f}", each.seconds),
            name_item(texts[each.row]),
            Item(f"{each.value:.{each.column['decimals']}f}", each.value),
            Item("n/a") if each.reference is None
            else Item(f"{each.reference:.{each.column['decimals']}f}", each.reference),
        ]
        for each in at_equal_time(summary)
    ]  # fmt: skip
    return Grid(
        "equal-time",
        "Equal time: the best row after so many seconds",
        "Seconds of training, all stages included; values during training, over a few test views, linear between"
        f" scored points; mean over {mean_over(summary, named=False)}.",
        ["metric", "seconds", "best row", "its value", "the reference's"],
        rows,
    )


def _error_parts(summary: Summary) -> Grid:
    parts, texts = summary.get("error_parts", {}), row_texts(summary)
    kinds = [kind for kind in PARTED if any(kind in each for each in parts.values())]
    return Grid(
        "error-parts",
        "Bias and variance",
        "Share of the squared error of kept test images, display sRGB, that differs between seeds, and that error as"
        " PSNR. The rest is common to all seeds: neither more seeds nor their mean removes it.",
        ["row", *(PARTED[kind] for kind in kinds)],
        [[name_item(texts[row]), *(_parts_item(each.get(kind)) for kind in kinds)] for row, each in parts.items()],
    )


def _parts_item(parts: ErrorParts | None) -> Item:
    if parts is None:
        return Item("n/a")
    share, psnr = variance_share(parts), -10 * math.log10(max(parts["error"], 1e-10))
    return Item(f"{share:.1f} % of {psnr:.2f} dB", share)


def _qualities(summary: Summary) -> Grid:
    texts = row_texts(summary)
    rows = [
        [
            name_item(each.column["label"]),
            Item(f"{100 * each.share:.0f} %", each.share),
            Item(f"{each.target:.{each.column['decimals']}f}", each.target),
            name_item(texts[each.row]),
            Item(f"{each.seconds:.1f}", each.seconds),
            Item(f"{each.reference:.1f}", each.reference),
            Item(f"{each.reached} of {len(summary['rows'])}", each.reached),
        ]
        for each in to_equal_quality(summary)
    ]
    return Grid(
        "equal-quality",
        "Equal quality: seconds until a target is reached",
        "A target is a share of the reference's gain from its first scored point to its last, on each scene and seed"
        " (the mean is shown). Time is linear between scored points. A row reaches a target if it does so on every"
        " scene and seed.",
        ["metric", "share", "target", "fastest row", "its seconds", "the reference's", "rows that reach it"],
        rows,
    )
