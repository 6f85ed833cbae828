"""Whether methods come in the published order: rank correlation with its uncertainty, and the pairs that do not."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.stats import kendalltau

from ..statistics import CONFIDENCE, Estimate, Pair, paired_difference
from ..summary import ColumnSummary, Summary, row_texts
from ..wording import count_of, heading, label_with_unit, signed
from .grid import Grid, Item, name_item
from .ranks import upwards
from .samples import values_of

FEWEST = 3
"""Methods that a rank correlation needs."""

RESAMPLES = 2_000
SEED = 0

HOW_TO_READ = (
    "Kendall's tau between the measured means and the published values: 1 where every two methods come in the published"
    " order, -1 where every two come in the other. In parentheses: percentiles 2.5 and 97.5 over"
    f" {RESAMPLES:,} resamples of the pairs of scene and seed; they speak of scenes like these alone. By chance: the"
    " share of all orders whose tau is at least as large."
)


class Reversal(NamedTuple):
    """Two methods that the paired interval puts in the order opposite to the published one.

    ``gain``: by how much ``better`` is better here, in the direction of better values; the published values are in the
    order better, worse.
    """

    better: str
    worse: str
    gain: Estimate
    published: tuple[float, float]


class Order(NamedTuple):
    """A column: tau with its interval (None for one pair of scene and seed), and the reversed pairs of methods."""

    column: ColumnSummary
    methods: int
    pairs: int
    tau: float
    low: float | None
    high: float | None
    by_chance: float
    reversals: list[Reversal]


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
    pairs = sorted(set.intersection(*(set(sample) for sample in samples.values()))) if samples else []
    if len(samples) < FEWEST or not pairs:
        return None
    values = np.array([[samples[row][pair] for pair in pairs] for row in samples])
    told = np.array([published[row] for row in samples])
    whole = kendalltau(values.mean(axis=1), told, alternative="greater")
    low, high = _interval(values, told)
    reversals = _reversals(column, samples, published)
    return Order(column, len(samples), len(pairs), float(whole.statistic), low, high, float(whole.pvalue), reversals)


def _interval(values: np.ndarray, told: np.ndarray) -> tuple[float | None, float | None]:
    """Percentiles of tau over resampled pairs; ``values``: [method, pair], ``told``: [method]."""
    count = values.shape[1]
    if count < 2:
        return None, None
    drawn = np.random.default_rng(SEED).integers(count, size=(RESAMPLES, count))
    taus = [kendalltau(values[:, chosen].mean(axis=1), told).statistic for chosen in drawn]
    low, high = np.quantile(taus, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def _reversals(
    column: ColumnSummary, samples: Mapping[str, Mapping[Pair, float]], published: Mapping[str, float]
) -> list[Reversal]:
    """Pairs of methods whose order here is resolved and is not the published one."""
    sign = 1.0 if column["direction"] == "up" else -1.0
    found = []
    for one, other in combinations(samples, 2):
        better, worse = (one, other) if published[one] < published[other] else (other, one)
        gain = paired_difference(samples[better], samples[worse])
        told = published[better] != published[worse]
        if told and gain is not None and gain.low is not None and gain.low > 0:
            found.append(Reversal(better, worse, gain, (sign * published[better], sign * published[worse])))
    return found


def _sentence(order: Order, reversal: Reversal, texts: Mapping[str, str]) -> str:
    decimals, gain = order.column["decimals"], reversal.gain
    ends = f"{signed(gain.low or 0.0, decimals)} to {signed(gain.high or 0.0, decimals)}"
    mine, theirs = (f"{value:.{decimals}f}" for value in reversal.published)
    return (
        f"{label_with_unit(order.column)}: {texts[reversal.better]} is better than {texts[reversal.worse]} here, by"
        f" {signed(gain.mean, decimals)} ({ends}); published the other way round, {mine} and {theirs}."
    )


def _grid(orders: Sequence[Order]) -> Grid:
    rows = []
    for order in orders:
        interval = "" if order.low is None or order.high is None else f" ({order.low:.2f} to {order.high:.2f})"
        rows.append(
            [
                name_item(heading(order.column)),
                Item(str(order.methods), order.methods),
                Item(str(order.pairs), order.pairs),
                Item(f"{order.tau:.2f}{interval}", order.tau),
                Item(f"{order.by_chance:.2f}", order.by_chance),
                Item(count_of(len(order.reversals), "pair"), len(order.reversals)),
            ]
        )
    heads = ["metric", "methods", "scenes x seeds", "tau", "by chance", "resolved the other way"]
    return Grid("published-order", "Measured and published order of the methods", HOW_TO_READ, heads, rows)
