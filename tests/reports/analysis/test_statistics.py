"""Means, intervals, paired differences and parts of their spread, against quadrature and simulation."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from radiogs_reports.statistics import (
    CONFIDENCE,
    Estimate,
    Level,
    Origin,
    Sample,
    estimate,
    mean_of,
    paired_difference,
    paired_ratio,
    spread,
)


def drawn(rng: np.random.Generator, scenes: int, seeds: int, between: float, mean: float = 0.0) -> Sample:
    """Values whose scenes deviate by ``between`` and seeds by one."""
    shifts = rng.normal(0, between, scenes)
    return {
        Origin(f"scene{scene}", seed): mean + shifts[scene] + rng.normal() for scene in range(scenes)
        for seed in range(seeds)
    }  # fmt: skip


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
    assert found.deviation == pytest.approx(np.std(values, ddof=1))
    assert found.p_value == pytest.approx(stats.ttest_1samp(values, 0.0).pvalue, rel=1e-9)


def test_with_a_single_scene_the_interval_is_over_its_seeds() -> None:
    found = mean_of({Origin("ball", seed): value for seed, value in enumerate((1.0, 2.0, 6.0))})
    assert found is not None
    assert (found.over, found.units, found.mean) == ("seeds", 3, 3.0)


def test_seeds_of_a_scene_are_counted_once() -> None:
    sample = {
        Origin(scene, seed): level + 0.01 * seed for scene, level in (("a", 1.0), ("b", 3.0)) for seed in range(9)
    }
    found = mean_of(sample)
    assert found is not None
    assert (found.over, found.units, found.values) == ("scenes", 2, 18)
    assert found.half_width == pytest.approx(stats.t.ppf(0.975, 1) * 1.0)


def test_kinds_count_alike_however_many_scenes_each_has() -> None:
    values = {Origin(f"round{place}", 0, "round"): 10.0 for place in range(6)} | {Origin("front", 0, "front"): 4.0}
    found = mean_of(values)
    assert found is not None
    assert (found.over, found.units, found.mean) == ("kinds", 2, 7.0)


def test_a_scene_with_fewer_seeds_counts_as_much_as_the_others() -> None:
    found = mean_of({Origin("a", 0): 1.0, Origin("a", 1): 3.0, Origin("a", 2): 2.0, Origin("b", 0): 8.0})
    assert found is not None
    assert found.mean == 5.0


def test_one_value_has_no_interval_and_none_has_no_mean() -> None:
    assert estimate([]) is None
    assert mean_of({}) is None
    assert estimate([2.0]) == Estimate(2.0, None, None, 1)


def test_pairing_removes_effects_of_scene_and_seed() -> None:
    rng = np.random.default_rng(1)
    reference = drawn(rng, 2, 3, 5.0, 30.0)
    sample = {origin: value + 0.1 + 0.01 * float(rng.normal()) for origin, value in reference.items()}
    found = paired_difference(sample, reference)
    assert found is not None
    assert (found.units, found.values) == (2, 6)
    assert found.mean == pytest.approx(0.1, abs=0.02)


def test_only_scenes_and_seeds_that_both_rows_have_are_compared() -> None:
    found = paired_difference(
        {Origin("a", 0): 2.0, Origin("a", 1): 9.0}, {Origin("a", 0): 1.0, Origin("b", 1): 5.0}
    )  # fmt: skip
    assert found == Estimate(1.0, None, None, 1)
    assert paired_difference({Origin("a", 0): 2.0}, {Origin("b", 0): 1.0}) is None


def test_a_row_compared_with_itself_differs_by_exactly_zero() -> None:
    sample = {Origin("a", 0): 0.1, Origin("a", 1): 0.7}
    found = paired_difference(sample, sample)
    assert found is not None
    assert (found.mean, found.low, found.high, found.p_value) == (0.0, 0.0, 0.0, 1.0)


def test_the_inverse_ratio_has_the_inverse_estimate() -> None:
    rng = np.random.default_rng(2)
    one, other = ({origin: math.exp(value) for origin, value in drawn(rng, 4, 2, 0.3).items()} for _ in range(2))
    there, back = paired_ratio(one, other), paired_ratio(other, one)
    assert there is not None
    assert back is not None
    assert there.mean * back.mean == pytest.approx(1.0)
    assert (there.low or 0) * (back.high or 0) == pytest.approx(1.0)
    assert there.p_value == pytest.approx(back.p_value)


def test_parts_of_the_spread_are_found_again() -> None:
    rng = np.random.default_rng(3)
    truth: dict[Level, float] = {"kinds": 3.0, "scenes": 2.0, "seeds": 1.0}
    sample = {}
    for kind in range(60):
        of_kind = rng.normal(0, truth["kinds"])
        for scene in range(4):
            of_scene = rng.normal(0, truth["scenes"])
            for seed in range(3):
                sample[Origin(f"{kind}-{scene}", seed, str(kind))] = of_kind + of_scene + rng.normal()
    found = spread(sample)
    assert {level: pytest.approx(size, rel=0.25) for level, size in truth.items()} == found


def test_unknown_parts_of_the_spread_are_left_out() -> None:
    assert spread({Origin("a", 0): 1.0}) == {}
    assert spread({Origin("a", 0): 1.0, Origin("a", 1): 3.0}) == {"seeds": pytest.approx(math.sqrt(2))}
    assert spread({Origin("a", 0): 1.0, Origin("b", 0): 3.0}) == {"scenes": pytest.approx(math.sqrt(2))}
    assert spread({Origin("a", 0, "x"): 1.0, Origin("b", 0, "y"): 3.0}) == {"kinds": pytest.approx(math.sqrt(2))}
    both = spread({Origin("a", 0): 1.0, Origin("a", 1): 3.0, Origin("b", 0): 11.0, Origin("b", 1): 13.0})
    assert both == {"seeds": pytest.approx(math.sqrt(2)), "scenes": pytest.approx(math.sqrt(50 - 1))}
