"""Means, intervals and paired differences, against quadrature and simulation."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from radiogs_reports.statistics import CONFIDENCE, Estimate, estimate, paired_difference


def t_density(value: float, freedom: int) -> float:
    """Student's density, from its formula."""
    scale = math.gamma((freedom + 1) / 2) / (math.sqrt(freedom * math.pi) * math.gamma(freedom / 2))
    return scale * (1 + value * value / freedom) ** (-(freedom + 1) / 2)


@pytest.mark.parametrize("count", [2, 3, 5, 12])
def test_the_interval_holds_95_percent_of_the_t_distribution(count: int) -> None:
    values = list(np.random.default_rng(count).normal(3.0, 2.0, count))
    found = estimate(values)
    assert found is not None
    assert found.half_width is not None
    standard_error = np.std(values, ddof=1) / math.sqrt(count)
    quantile = found.half_width / standard_error
    assert quad(t_density, -quantile, quantile, args=(count - 1,))[0] == pytest.approx(CONFIDENCE, abs=1e-9)
    assert found.mean == pytest.approx(np.mean(values))


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(1000):
        found = estimate(list(rng.normal(1.0, 0.3, 3)))
        assert found is not None
        assert found.half_width is not None
        covered += abs(found.mean - 1.0) <= found.half_width
    assert covered == pytest.approx(950, abs=25)  # 3.6 standard deviations of a binomial


def test_one_value_has_no_interval_and_none_has_no_mean() -> None:
    assert estimate([]) is None
    assert estimate([2.0]) == Estimate(2.0, None, None, 1)


def test_pairing_removes_what_scene_and_seed_add() -> None:
    rng = np.random.default_rng(1)
    pairs = [(scene, seed) for scene in ("a", "b") for seed in range(3)]
    reference = {pair: float(rng.normal(30, 5)) for pair in pairs}
    sample = {pair: value + 0.1 + 0.01 * float(rng.normal()) for pair, value in reference.items()}
    found = paired_difference(sample, reference)
    assert found is not None
    assert found.count == 6
    assert found.mean == pytest.approx(0.1, abs=0.02)
    assert found.low is not None
    assert found.low > 0


def test_only_pairs_that_both_rows_have_are_compared() -> None:
    found = paired_difference({("a", 0): 2.0, ("a", 1): 9.0}, {("a", 0): 1.0, ("b", 1): 5.0})
    assert found == Estimate(1.0, None, None, 1)
    assert paired_difference({("a", 0): 2.0}, {("b", 0): 1.0}) is None


def test_a_row_compared_with_itself_differs_by_exactly_zero() -> None:
    sample = {("a", 0): 0.1, ("a", 1): 0.7}
    assert paired_difference(sample, sample) == Estimate(0.0, 0.0, 0.0, 2)
