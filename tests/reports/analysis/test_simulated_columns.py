"""Simulated columns: the coverage of intervals, and the rate of false differences between equal rows."""

from itertools import product

import numpy as np
import pytest

from radiogs_reports.analysis.comparisons import ranks, to_reference
from radiogs_reports.statistics import CONFIDENCE, Origin, Sample, paired_difference

GRID = tuple(product((2, 3, 12), (1, 3, 5), (0.2, 1.0, 5.0)))
"""Scenes, seeds, and the spread between scenes over that between seeds."""


def identical_rows(rng: np.random.Generator, rows: int, scenes: int, runs: int, between: float) -> dict[str, Sample]:
    """A column whose rows do not differ in the mean over scenes; scenes change a row by ``between`` seeds' spreads."""
    return {
        str(row): {
            Origin(str(scene), seed): float(shift_of_scene + rng.normal())
            for scene, shift_of_scene in enumerate(rng.normal(0, between, scenes))
            for seed in range(runs)
        }
        for row in range(rows)
    }


def covered(scenes: int, seeds: int, between: float, columns: int) -> float:
    """How often the interval of a difference holds the mean difference of scenes like these."""
    rng = np.random.default_rng([scenes, seeds, round(10 * between)])
    hits = 0
    for _ in range(columns):
        found = paired_difference(*identical_rows(rng, 2, scenes, seeds, between).values())
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        hits += found.low <= 0 <= found.high
    return hits / columns


def test_intervals_cover_the_mean_over_scenes_at_their_confidence() -> None:
    shares = [covered(*case, columns=300) for case in GRID]
    assert np.mean(shares) == pytest.approx(CONFIDENCE, abs=0.01)  # 4 standard deviations of a binomial
    assert min(shares) > 0.9


def false_shares(rows: int, scenes: int, runs: int, between: float, columns: int) -> tuple[float, float]:
    """How many columns of rows that do not differ have a false difference to the reference row, and a false rank."""
    rng = np.random.default_rng([rows, scenes, runs, round(10 * between)])
    references = pairs = 0
    for _ in range(columns):
        samples = identical_rows(rng, rows, scenes, runs, between)
        references += any(each.verdict is not None for each in to_reference(samples, "0", "up").values())
        pairs += any(rank != 1 for rank in ranks(samples, "up").values())
    return references / columns, pairs / columns


def test_equal_rows_have_a_false_difference_in_one_column_of_twenty_at_most() -> None:
    cases = [(2, 3, 2, 1.0), (7, 4, 3, 0.2), (7, 4, 3, 5.0), (5, 12, 1, 1.0)]
    shares = np.array([false_shares(*case, columns=300) for case in cases])
    assert shares.max() <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / 300)
    assert shares.mean() <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / (300 * len(cases)))
