"""Measured against published order of methods: rank correlation, and the pairs of methods that are resolved."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.stats import kendalltau

from ..statistics import Estimate, mean_of, paired_difference
from ..summary import ColumnSummary, Summary, row_texts
from ..wording import heading, label_with_unit, signed
from .comparisons import beaten, upwards
from .report import Grid, Record, Report, name_item, number_item
from .samples import level_in, values_of

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
    published: tuple[float, float]
    """Published values of ``better`` and ``worse``."""


class Order(NamedTuple):
    """The measured and the published order of the methods in a column."""

    column: ColumnSummary
    methods: int
    tau: float
    """Kendall's tau-b between the measured and the published values."""
    low: float
    """The lowest tau of an order of the methods in which all resolved pairs come as they are resolved."""
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
    texts = row_texts(summary)
    sentences = [HOW_TO_READ, *(_sentence(order, each, texts) for order in orders for each in order.reversals)]
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
    names, goals, over = list(alike), list(published.values()), level_in(summary, column["key"])
    told = {(better, each) for better, worse in (beaten(alike, "up", over) or {}).items() for each in worse}
    confirmed = sum(published[better] > published[each] for better, each in told)
    printed = {row: summary["published"][row][column["key"]] for row in published}
    reversals = [
        Reversal(better, other, gain, (printed[better], printed[other]))
        for better, other in sorted(told, key=lambda pair: [*map(names.index, pair)])
        if published[better] < published[other] and (gain := paired_difference(alike[better], alike[other], over))
    ]
    low, high = _bounds(goals, {(names.index(better), names.index(other)) for better, other in told})
    tau = float(kendalltau(means, goals).statistic)
    return Order(column, len(alike), tau, low, high, _by_chance(means, goals), confirmed, reversals)


def _bounds(published: Sequence[float], resolved: Collection[tuple[int, int]]) -> tuple[float, float]:
    """The lowest and the highest tau-b of orders in which the first of each resolved pair comes before the second.

    A linear program over whole numbers: x of a pair is 1 where its first comes first, and of three methods none may
    come in a circle (Grötschel, Jünger and Reinelt, "A cutting plane algorithm for the linear ordering problem", 1984).
    """
    pairs = list(combinations(range(len(published)), 2))
    place = {pair: each for each, pair in enumerate(pairs)}
    worth = np.sign([published[one] - published[other] for one, other in pairs])
    circles = np.zeros((math.comb(len(published), 3), len(pairs)))
    for row, (one, two, three) in zip(circles, combinations(range(len(published)), 3), strict=True):
        row[[place[one, two], place[two, three], place[one, three]]] = 1, 1, -1
    bounds = Bounds([pair in resolved for pair in pairs], [pair[::-1] not in resolved for pair in pairs])
    ends = (
        sign * milp(sign * worth, integrality=1, bounds=bounds, constraints=LinearConstraint(circles, 0, 1)).fun
        for sign in (1, -1)
    )
    scale = math.sqrt(len(pairs) * np.count_nonzero(worth))
    low, high = ((2 * end - worth.sum()) / scale for end in ends)
    return float(low), float(high)


def _by_chance(measured: Sequence[float], published: Sequence[float]) -> float:
    """The share of all orders of the published values whose tau with the measured ones is at least as large.

    Exact, also where values of either side are equal: values are given to ever better methods, those of equal means at
    once, and the ways to give each set of them are counted by the pairs in order less those out of order.
    """
    ways: dict[tuple[float, ...], Counter[int]] = {(): Counter({0: 1})}
    for _, size in sorted(Counter(measured).items()):
        grown: dict[tuple[float, ...], Counter[int]] = defaultdict(Counter)
        for given, counts in ways.items():
            left = sorted((Counter(published) - Counter(given)).elements())
            for chosen in combinations(left, size):
                gained = sum((new > old) - (new < old) for new in chosen for old in given)
                for score, count in counts.items():
                    grown[tuple(sorted(given + chosen))][score + gained] += count
        ways = grown
    (counts,) = ways.values()
    pairs = combinations(zip(measured, published, strict=True), 2)
    found = sum(((a > c) - (a < c)) * ((b > d) - (b < d)) for (a, b), (c, d) in pairs)
    return sum(count for score, count in counts.items() if score >= found) / counts.total()


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
