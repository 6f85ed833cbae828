"""Efficiency of a row, 1 / (MSE x seconds), relative to the reference row's."""

from typing import NamedTuple

from ..statistics import Estimate, Origin, paired_ratio
from ..summary import ColumnSummary, Summary, reference_of
from .samples import costs_of, values_of


class Efficiency(NamedTuple):
    """Ratio of a row's efficiency to the reference row's, in one column."""

    row: str
    column: ColumnSummary
    ratio: Estimate


def efficiencies(summary: Summary) -> list[Efficiency]:
    """Ratios for every row and every column in decibels, the reference row included."""
    found = []
    for row in summary["rows"]:
        for column in summary["columns"]:
            if column["unit"] != "dB":
                continue
            ratio = paired_ratio(*(_efficiency(summary, key, column) for key in (row["key"], reference_of(summary))))
            if ratio is not None:
                found.append(Efficiency(row["key"], column, ratio))
    return found


def _efficiency(summary: Summary, row: str, column: ColumnSummary) -> dict[Origin, float]:
    """1 / (MSE x seconds) by (scene, seed), with MSE = 10^(-PSNR / 10) for peak 1."""
    seconds = costs_of(summary, row, "seconds")
    return {
        origin: 10 ** (decibels / 10) / seconds[origin]
        for origin, decibels in values_of(summary, row, column["key"]).items()
        if origin in seconds
    }
