"""Medians, ratios and laws of growth, each with its interval, against other ways to compute them."""

from statistics import median

import numpy as np
import pytest
from scipy import optimize, stats

from radiogs_bench.lab.steps.estimates import last_exponent, law_of, median_of, ratio_of_medians


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


SIZES = [750, 1500, 3000, 6000, 12_000]


def repeated(constant: float, grown: float, exponent: float, noise: float = 0.02) -> list[list[float]]:
    """Noisy measurements of a law, six at each size."""
    drawn = np.random.default_rng(5)
    exact = [constant + grown * (size / SIZES[-1]) ** exponent for size in SIZES]
    return [list(value * np.exp(noise * drawn.normal(size=6))) for value in exact]


@pytest.mark.parametrize(("constant", "exponent"), [(0.02, 1.0), (0.05, 0.6), (0.0, 0.8), (0.0, 1.5)])
def test_the_law_that_made_the_measurements_is_found(constant: float, exponent: float) -> None:
    law = law_of(SIZES, repeated(constant, 0.1, exponent))
    assert law is not None
    assert law.exponent is not None
    for found, true in ((law.constant, constant), (law.grown, 0.1), (law.exponent, exponent)):
        assert found.low is not None
        assert found.high is not None
        assert found.low <= true <= found.high
    assert law.exponent.value == pytest.approx(exponent, abs=0.1)
    assert law.exponent.high - law.exponent.low < 0.5


def test_the_law_is_that_of_least_squares_of_logarithms() -> None:
    """For small deviations those of logarithms are the relative ones."""
    amounts = repeated(0.03, 0.1, 0.9, noise=0.01)
    law = law_of(SIZES, amounts)
    middle = np.array([median(each) for each in amounts])

    def off(law: np.ndarray) -> np.ndarray:
        return np.log(law[0] + law[1] * (np.array(SIZES) / SIZES[-1]) ** law[2]) - np.log(middle)

    expected = optimize.least_squares(off, (0.01, 0.1, 1.0), bounds=(0, 3)).x
    assert law is not None
    assert law.exponent is not None
    assert (law.constant.value, law.grown.value) == pytest.approx(expected[:2], rel=0.02)
    assert law.exponent.value == pytest.approx(expected[2], abs=0.01)


def test_what_does_not_grow_has_no_exponent_and_few_sizes_have_no_law() -> None:
    falling = [[5.0], [4.0], [3.9], [3.8], [3.8]]
    law = law_of(SIZES, falling)
    assert law is not None
    assert (law.grown.value, law.exponent) == (0, None)
    assert law_of(SIZES, repeated(0.1, 0.005, 1.0))[2] is None, "rises by 5 %"
    assert law_of(SIZES[:3], falling[:3]) is None
    assert law_of(SIZES, [[1.0], [0.0], [1.0], [2.0], [3.0]]) is None


def test_single_measurements_tell_a_law_without_intervals() -> None:
    law = law_of(SIZES, [[values[0]] for values in repeated(0.0, 0.1, 0.8)])
    assert law is not None
    assert [(each.low, each.high) for each in law if each is not None] == 3 * [(None, None)]


def test_the_exponent_at_the_end_is_that_of_the_last_two_sizes() -> None:
    amounts = repeated(0.05, 0.1, 1.0)
    last = last_exponent(SIZES, amounts)
    true = np.log(0.15 / 0.1) / np.log(2)
    assert last is not None
    assert last.value == pytest.approx(np.log(median(amounts[-1]) / median(amounts[-2])) / np.log(2))
    assert last.low is not None
    assert last.high is not None
    assert last.low <= true <= last.high
    assert last.high - last.low == pytest.approx(4 * 1.25 * 0.02 * np.sqrt(2 / 6) / np.log(2), rel=0.5)
    assert last_exponent(SIZES, [*amounts[:-1], [0.0]]) is None
