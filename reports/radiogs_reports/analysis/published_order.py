"""Measured against published order of methods: rank correlation, and the pairs of methods that are resolved."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

from scipy.stats import kendalltau

from ..statistics import Estimate, Origin, mean_of, paired_difference
from ..summary import ColumnSummary, Summary, row_texts
from ..wording import heading, label_with_unit, signed
from .comparisons import beaten, upwards
from .grid import Grid, Item, name_item
from .samples import values_of

FEWEST = 3
"""The fewest methods of a rank correlation."""

HOW_TO_READ = (
    "Kendall's tau between the measured means and the published values: 1 where every two methods come in the published"
    " order, -1 where every two come in the other. By chance: the share of all orders whose tau is at least as large."
    " Resolved: pairs of methods that paired t tests tell apart, with Holm's correction over all pairs of the column."
    " Lowest and highest tau: those of the orders that agree with all resolved pairs; in at least 95 % of cases the tau"
    " of more scenes like these lies between them."
)


class Reversal(NamedTuple):
    """Two methods that are resolved to come in the order opposite to the published one."""

    better: str
    worse: str
    gain: Estimate
    """Difference of ``better`` and ``worse`` here, in the direction of better values."""
    published: tuple[float, float]
    """Published values of ``better`` and ``worse``, with the sign that makes larger ones better."""


class Order(NamedTuple):
    """The measured and the published order of the methods in a column."""

    column: ColumnSummary
    methods: int
    """Number of methods."""
    tau: float
    """Kendall's tau-b between the measured and the published values."""
    low: float
    """Tau if all pairs that are not resolved came in the order opposite to the published one."""
    high: float
    """Tau if all pairs that are not resolved came in the published order."""
    by_chance: float
    """P value of tau if all orders were equally likely."""
    confirmed: int
    """Number of pairs that are resolved in the published order."""
    reversals: list[Reversal]
    """The pairs that are resolved in the other order."""


class OrderReport(NamedTuple):
    """The columns, sentences about them, and the grid that shows them."""

    orders: list[Order]
    sentences: list[str]
    grid: Grid


def order_report(summary: Summary) -> OrderReport | None:
    """The report of a run; None unless a column has three rows of different methods with a published value each."""
    rows = _of_different_methods(summary)
    orders = [order for column in summary["columns"] if (order := _order(summary, column, rows)) is not None]
    if not orders:
        return None
    texts = row_texts(summary)
    sentences = [HOW_TO_READ, *(_sentence(order, each, texts) for order in orders for each in order.reversals)]
    return OrderReport(orders, sentences, _grid(orders))


def _of_different_methods(summary: Summary) -> list[str]:
    """The first row of every method that has a finished cell."""
    first: dict[str, str] = {}
    for run in summary["runs"]:
        if run["made_from"]:
            first.setdefault(run["made_from"].get("method", run["row"]), run["row"])
    return [row["key"] for row in summary["rows"] if row["key"] in first.values()]


def _order(summary: Summary, column: ColumnSummary, rows: Sequence[str]) -> Order | None:
    if column["direction"] == "zero":
        return None
    published, samples = {}, {}
    for row in rows:
        value, sample = summary["published"].get(row, {}).get(column["key"]), values_of(summary, row, column["key"])
        if value is not None and sample:
            published[row] = value if column["direction"] == "up" else -value
            samples[row] = dict(upwards(sample, column["direction"]))
    shared = set.intersection(*(set(sample) for sample in samples.values())) if samples else set()
    if len(samples) < FEWEST or not shared:
        return None
    alike = {row: {origin: sample[origin] for origin in shared} for row, sample in samples.items()}
    means = [mean.mean for sample in alike.values() if (mean := mean_of(sample)) is not None]
    whole = kendalltau(means, list(published.values()), alternative="greater")
    worse = beaten(alike, "up") or {}
    told = [pair for pair in combinations(alike, 2) if published[pair[0]] != published[pair[1]]]
    ordered = [(one, other) if published[one] > published[other] else (other, one) for one, other in told]
    confirmed = sum(second in worse.get(first, set()) for first, second in ordered)
    reversals = [
        _reversal(column, alike, published, better=second, worse=first)
        for first, second in ordered
        if first in worse.get(second, set())
    ]
    low, high = _bounds(published, confirmed, len(reversals), len(ordered))
    return Order(column, len(alike), float(whole.statistic), low, high, float(whole.pvalue), confirmed, reversals)


def _bounds(published: Mapping[str, float], confirmed: int, reversed_: int, ordered: int) -> tuple[float, float]:
    """Kendall's tau-b with every pair that is not resolved in the other order, and in the published one."""
    pairs = math.comb(len(published), 2)
    scale = math.sqrt(pairs * ordered)
    return (2 * confirmed - ordered) / scale, (ordered - 2 * reversed_) / scale


def _reversal(
    column: ColumnSummary,
    samples: Mapping[str, Mapping[Origin, float]],
    published: Mapping[str, float],
    better: str,
    worse: str,
) -> Reversal:
    sign = 1.0 if column["direction"] == "up" else -1.0
    gain = paired_difference(samples[better], samples[worse])
    assert gain is not None
    return Reversal(better, worse, gain, (sign * published[better], sign * published[worse]))


def _sentence(order: Order, reversal: Reversal, texts: Mapping[str, str]) -> str:
    decimals, gain = order.column["decimals"], reversal.gain
    ends = f"{signed(gain.low or 0.0, decimals)} to {signed(gain.high or 0.0, decimals)}"
    mine, theirs = (f"{value:.{decimals}f}" for value in reversal.published)
    return (
        f"{label_with_unit(order.column)}: {texts[reversal.better]} is better than {texts[reversal.worse]} here, by"
        f" {signed(gain.mean, decimals)} ({ends}); published the other way round, {mine} and {theirs}."
    )


def _grid(orders: Sequence[Order]) -> Grid:
    rows = [
        [
            name_item(heading(order.column)),
            Item(str(order.methods), order.methods),
            Item(f"{order.tau:.2f}", order.tau),
            Item(f"{order.low:.2f}", order.low),
            Item(f"{order.high:.2f}", order.high),
            Item(f"{order.by_chance:.2f}", order.by_chance),
            Item(str(order.confirmed), order.confirmed),
            Item(str(len(order.reversals)), len(order.reversals)),
        ]
        for order in orders
    ]
    heads = [
        "metric", "methods", "tau", "lowest tau", "highest tau", "by chance", "pairs resolved as published",
        "pairs resolved the other way",
    ]  # fmt: skip
    return Grid("published-order", "Measured and published order of the methods", HOW_TO_READ, heads, rows)
