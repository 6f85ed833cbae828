"""Medians, ratios and laws of growth, each with its interval, against other ways to compute them."""

import pytest
import torch
from scipy import stats

from radiogs_bench.lab.steps.estimates import exponent_of, median_of, ratio_of_medians


def test_an_interval_of_a_median_holds_as_much_as_it_says() -> None:
    values = [float(each) for each in range(20)]
    found = median_of([values[10:], values[:10]])
    assert (found.value, found.low, found.high) == (9.5, 5, 14)
    assert 1 - 2 * stats.binom.cdf(5, 20, 0.5) >= 0.95
    assert 1 - 2 * stats.binom.cdf(6, 20, 0.5) < 0.95
    assert median_of([values[:5]])[1:] == (None, None)


def test_a_ratio_above_one_is_faster_now_and_pairs_share_their_load() -> None:
    loads = [1.0, 3.0, 2.0, 5.0, 1.5, 4.0, 2.5, 1.2]
    before, after = [[2 * load] for load in loads], [[load] for load in loads]
    paired, apart = (ratio_of_medians(before, after, each) for each in (True, False))
    assert paired == (2.0, 2.0, 2.0)
    assert apart.value == 2.0
    assert apart.low is not None
    assert apart.low < 1.5
    assert ratio_of_medians(before[:1], after[:1], True) == (2.0, None, None)


def test_times_below_a_clock_tick_have_no_ratio() -> None:
    some, none = [[1.0], [2.0], [3.0]], [[0.0], [0.0], [4.0]]
    assert ratio_of_medians(some, none, True) is None
    assert ratio_of_medians(none, some, True) is None
    assert ratio_of_medians([[0.0], *some], some, False) == (0.75, None, None)


def test_an_exponent_is_the_slope_of_logarithms() -> None:
    sizes, amounts = [10, 20, 40, 80], [1.0, 2.1, 3.8, 8.3]
    found, line = (
        exponent_of(sizes, amounts),
        stats.linregress(*(torch.tensor(each).log() for each in (sizes, amounts))),
    )
    assert found is not None
    reach = stats.t.ppf(0.975, 2) * line.stderr
    assert found == pytest.approx((line.slope, line.slope - reach, line.slope + reach), rel=1e-4)
    assert exponent_of([1, 2, 3], [1.0, 0.0, 1.0]) is None
