"""Tables of the cost of accuracy: slopes, Pareto fronts, efficiency, equal time, equal quality, bias and variance."""

import math
from collections.abc import Mapping, Sequence

from ..statistics import Estimate, level_of, paired_ratio
from ..summary import ErrorParts, Summary, reference_of, row_texts
from ..wording import label_with_unit, population_of
from .cost_knobs import Doubling, Knob
from .cost_progress import equal_quality, equal_time
from .pareto import points
from .report import Grid, Item, estimate_item, factor_item, name_item, number_item
from .samples import COSTS, costs_of, values_of

PARTED: Mapping[str, str] = {
    "image": "new views", "albedo": "albedo", "indirect": "indirect light", "relit": "relit views",
}  # fmt: skip
"""Kinds of images, by their name in the summary's ``error_parts``."""

UNSHARED = "no scene and seed has every setting"


def cost_grids(summary: Summary, turned: Sequence[Knob], found: Sequence[Doubling]) -> list[Grid]:
    """The tables with at least one row. ``found``: the slopes of the knobs."""
    grids = [
        _doublings(summary, turned, found),
        _fronts(summary),
        _efficiencies(summary),
        equal_time(summary),
        equal_quality(summary),
        _error_parts(summary),
    ]
    return [grid for grid in grids if grid.rows]


def efficiencies(summary: Summary) -> dict[tuple[str, str], Estimate]:
    """The ratio of a row's efficiency, 1 / (MSE x seconds), to the reference row's, by row and column in decibels.

    The MSE is 10^(-PSNR / 10), for peak 1. The reference row is included.
    """
    found = {}
    for key in (column["key"] for column in summary["columns"] if column["unit"] == "dB"):
        samples = {}
        for row in (each["key"] for each in summary["rows"]):
            seconds, decibels = costs_of(summary, row, "seconds"), values_of(summary, row, key)
            samples[row] = {at: 10 ** (decibels[at] / 10) / seconds[at] for at in decibels if at in seconds}
        for row, sample in samples.items():
            ratio = paired_ratio(sample, samples[reference_of(summary)], level_of(*samples.values()))
            if ratio is not None:
                found[row, key] = ratio
    return found


def variance_share(parts: ErrorParts) -> float:
    """Percentage of a squared error that is variance between seeds; 0 without an error."""
    return 100 * parts["variance"] / parts["error"] if parts["error"] > 0 else 0.0


def _doublings(summary: Summary, turned: Sequence[Knob], found: Sequence[Doubling]) -> Grid:
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
    rows = [
        [
            name_item(column["label"]),
            name_item(label),
            name_item(texts[point.row]),
            Item(f"{point.cost:.1f}" if cost == "seconds" else f"{point.cost / 1e6:.3f} million", point.cost),
            number_item(point.quality, column["decimals"]),
        ]
        for column in summary["columns"]
        for cost, label in COSTS.items()
        for point in sorted(points(summary, column, cost), key=lambda each: each.cost)
        if point.on_front
    ]
    return Grid(
        "fronts",
        "Pareto fronts",
        "Rows resolved to be better, and to cost more, than the cheaper ones of them; plots and CSV hold all points.",
        ["metric", "cost", "row", "amount", "value"],
        rows,
    )


def _efficiencies(summary: Summary) -> Grid:
    found = efficiencies(summary)
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
