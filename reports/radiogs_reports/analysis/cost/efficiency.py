"""Efficiency of a row, 1 / (MSE x seconds), as a multiple of the reference row's."""

from typing import NamedTuple

from ...summary import ColumnSummary, Summary, reference_of
from ..paired import Estimate, Pair, costs_of, figures_of, ratio


class Efficiency(NamedTuple):
    """Of a row in a column that is in decibels."""

    row: str
    column: ColumnSummary
    times: Estimate


def efficiencies(summary: Summary) -> list[Efficiency]:
    """Of every row and every column that is a PSNR."""
    found = []
    for row in summary["rows"]:
        for column in summary["columns"]:
            if column["unit"] != "dB":
                continue
            times = ratio(*(_of(summary, key, column["key"]) for key in (row["key"], reference_of(summary))))
            if times is not None:
                found.append(Efficiency(row["key"], column, times))
    return found


def _of(summary: Summary, row: str, column: str) -> dict[Pair, float]:
    """1 / (MSE x seconds) by (scene, seed), where MSE = 10^(-PSNR / 10) of the mean PSNR, peak 1."""
    seconds = costs_of(summary, row, "seconds")
    return {
        pair: 10 ** (figure / 10) / seconds[pair]
        for pair, figure in figures_of(summary, row, column).items()
        if pair in seconds
    }
