"""Measured against published order of methods: rank correlation, and the pairs of methods that are resolved."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kendalltau

from ..statistics import Estimate, mean_of, paired_difference
from ..summary import ColumnSummary, Summary, row_texts
from ..wording import heading, label_with_unit, signed
from .comparisons import beaten, upwards
from .report import Grid, Record, Report, name_item, number_item
from .samples import values_of

FEWEST = 3
"""The fewest methods of a rank correlation."""

HOW_TO_READ = (
    "Kendall's tau between the measured means and the published values: 1 where every two methods come in the published"
    " order, -1 where every two come in the other. By chance: the share of all orders of the published values whose tau"
    " is at least as large."
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


class Order(NamedTuple):
    """The measured and the published order of the methods in a column."""

    column: ColumnSummary
    methods: int
    tau: float
    """Kendall's tau-b between the measured and the published values."""
    low: float
    """The lowest tau of any order of the methods that respects all resolved pairs."""
    high: float
    """The highest tau of such an order."""
    by_chance: float
    """P value of tau if all orders were equally likely."""
    confirmed: int
    """Number of pairs that are resolved in the published order."""
    reversals: list[Reversal]
    """The pairs that are resolved in the other order."""


def order_report(summary: Summary) -> Report | None:
    """The report of a run; None unless a column has three rows of different methods with a published value each."""
    orders = orders_of(summary)
    if not orders:
        return None
    sentences = [HOW_TO_READ, *(_sentence(summary, order, each) for order in orders for each in order.reversals)]
    return Report(sentences, [_grid(orders)], [_record(order) for order in orders])


def orders_of(summary: Summary) -> list[Order]:
    """The order of methods, by their first finished rows, in each column with ``FEWEST`` or more published values."""
    first: dict[str, str] = {}
    for run in summary["runs"]:
        if run["made_from"]:
            first.setdefault(run["made_from"].get("method", run["row"]), run["row"])
    rows = [row["key"] for row in summary["rows"] if row["key"] in first.values()]
    return [order for column in summary["columns"] if (order := _order(summary, column, rows)) is not None]


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
    if len(samples) < FEWEST or len({*published.values()}) == 1 or not shared:
        return None
    alike = {row: {origin: sample[origin] for origin in shared} for row, sample in samples.items()}
    means = [mean.mean for sample in alike.values() if (mean := mean_of(sample)) is not None]
    rows, worse = list(alike), beaten(alike, "up") or {}
    told = [(better, each) for better in rows for each in rows if each in worse.get(better, ())]
    reversals = [
        Reversal(better, other, gain)
        for better, other in told
        if published[better] < published[other] and (gain := paired_difference(alike[better], alike[other]))
    ]
    confirmed = sum(published[better] > published[other] for better, other in told)
    signs, measured = (np.sign(np.subtract.outer(side, side)).astype(int) for side in ([*published.values()], means))
    every = _scores(signs, [size for _, size in sorted(Counter(means).items())], [set[int]() for _ in rows])
    by_chance = sum(count for score, count in every.items() if 2 * score >= (signs * measured).sum()) / every.total()
    agreeing = _scores(signs, [1 for _ in rows], [{rows.index(each) for each in worse.get(row, ())} for row in rows])
    scale = math.sqrt(math.comb(len(rows), 2) * np.count_nonzero(signs) / 2)  # of tau-b
    tau = float(kendalltau(means, [*published.values()]).statistic)
    low, high = min(agreeing) / scale, max(agreeing) / scale
    return Order(column, len(rows), tau, low, high, by_chance, confirmed, reversals)


def _scores(signs: NDArray[np.int_], sizes: Sequence[int], worse: Sequence[set[int]]) -> Counter[int]:
    """The number of orders of the methods, by their number of pairs as published minus reversed pairs.

    ``signs``: of published differences, [method, method]. ``sizes``: of groups of equal places, the worst first.
    ``worse``: the methods that have to be placed before each. Exact, over 2^n sets of placed methods, not n! orders.
    """
    ways = {frozenset[int](): Counter({0: 1})}
    for size in sizes:
        grown: dict[frozenset[int], Counter[int]] = defaultdict(Counter)
        for placed, counts in ways.items():
            free = [each for each, before in enumerate(worse) if each not in placed and before <= placed]
            for chosen in combinations(free, size):
                gained = int(signs[np.ix_(chosen, [*placed])].sum())
                for score, count in counts.items():
                    grown[placed.union(chosen)][score + gained] += count
        ways = grown
    (counts,) = ways.values()
    return counts


def _sentence(summary: Summary, order: Order, reversal: Reversal) -> str:
    decimals, gain, texts = order.column["decimals"], reversal.gain, row_texts(summary)
    ends = f"{signed(gain.low or 0.0, decimals)} to {signed(gain.high or 0.0, decimals)}"
    published = (summary["published"][row][order.column["key"]] for row in (reversal.better, reversal.worse))
    mine, theirs = (f"{value:.{decimals}f}" for value in published)
    return (
        f"{label_with_unit(order.column)}: {texts[reversal.better]} is better than {texts[reversal.worse]} here, by"
        f" {signed(gain.mean, decimals)} ({ends}); published the other way round, {mine} and {theirs}."
    )


def _grid(orders: Sequence[Order]) -> Grid:
    rows = [
        [
            name_item(heading(order.column)),
            number_item(order.methods),
            *(number_item(each, 2) for each in (order.tau, order.low, order.high, order.by_chance)),
            number_item(order.confirmed),
            number_item(len(order.reversals)),
        ]
        for order in orders
    ]
    heads = [
        "metric", "methods", "tau", "lowest tau", "highest tau", "by chance", "pairs resolved as published",
        "pairs resolved the other way",
    ]  # fmt: skip
    return Grid("published-order", "Measured and published order of the methods", HOW_TO_READ, heads, rows)


def _record(order: Order) -> Record:
    return {
        "column": order.column["key"], "methods": order.methods, "tau": order.tau, "tau_low": order.low,
        "tau_high": order.high, "by_chance": order.by_chance, "confirmed": order.confirmed,
        "reversed": "; ".join(f"{each.better} > {each.worse}" for each in order.reversals) or None,
    }  # fmt: skip
