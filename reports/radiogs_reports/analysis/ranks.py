"""Ranks of rows in a column: of measured values by paired intervals, of published values as printed."""

import math
from collections.abc import Mapping
from typing import Literal

from ..statistics import Sample, paired_difference
from ..summary import ColumnSummary, Summary

Direction = Literal["up", "down", "zero"]


def printed_ranks(printed: Mapping[str, float], direction: Direction) -> dict[str, int]:
    """Rank from 1 by row key, of values as printed; equal ones share a rank, and the next value has the next rank."""
    compared = {key: abs(value) if direction == "zero" else value for key, value in printed.items()}
    order = sorted(set(compared.values()), reverse=direction == "up")
    return {key: order.index(value) + 1 for key, value in compared.items()}


def upwards(sample: Sample, direction: Direction) -> Sample:
    """The values with the sign that makes larger ones better."""
    if direction == "up":
        return sample
    return {pair: -abs(value) if direction == "zero" else -value for pair, value in sample.items()}


def resolved_ranks(samples: Mapping[str, Sample], direction: Direction) -> dict[str, int]:
    """Rank from 1 by row key, of rows with values by (scene, seed).

    In the order of their means, a row shares the rank above it unless the paired 95 % interval tells it from the best
    row of that rank. Empty where no two rows share two pairs: then nothing tells them apart.
    """
    upward = {row: upwards(sample, direction) for row, sample in samples.items() if sample}
    means = {row: math.fsum(sample.values()) / len(sample) for row, sample in upward.items()}
    order = sorted(means, key=lambda row: -means[row])
    ranks: dict[str, int] = {}
    best, compared = "", False
    for row in order:
        difference = paired_difference(upward[best], upward[row]) if best else None
        compared = compared or (difference is not None and difference.low is not None)
        worse = difference is not None and difference.low is not None and difference.low > 0
        ranks[row] = ranks[best] + worse if best else 1
        best = row if worse or not best else best
    return ranks if compared else {}


def suite_ranks(summary: Summary, column: ColumnSummary) -> dict[str, int]:
    """Ranks of the rows of the table; empty without a reference row, where rows are not variants of one method."""
    if summary["reference"] is None:
        return {}
    ranks = {row: cells[column["key"]].get("rank") for row, cells in summary["cells"].items()}
    return {row: rank for row, rank in ranks.items() if rank is not None}
