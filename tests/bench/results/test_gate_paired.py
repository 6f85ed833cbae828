"""The gate's test of paired differences: its error rate, its power, and what it does with a single seed."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from radiogs_bench.results.paired import BAND, ERROR_RATE, SIMULATED_POWER, Paired, detectable

DRAWS = 4000
SEEDS = 3


def drawn(loss: float, deviation: float = 0.05) -> list[Paired]:
    """Runs whose differences are ``-loss`` and a rerun's noise."""
    random = np.random.default_rng(5)
    now = random.normal(-loss, deviation, (DRAWS, SEEDS))
    noise = random.normal(0, deviation, (DRAWS, SEEDS))
    return [Paired(ours.tolist(), theirs.tolist()) for ours, theirs in zip(now, noise, strict=True)]


def test_without_a_loss_the_p_value_is_uniform() -> None:
    lost = [each.p_value for each in drawn(0.0) if each.mean < 0]
    for rate in (0.01, 0.05, 0.2):
        expected = rate * DRAWS
        assert abs(sum(p < rate for p in lost) - expected) < 4 * expected**0.5


@pytest.mark.parametrize("tests", [1, 19])
def test_the_detectable_loss_is_found_in_four_of_five_runs(tests: int) -> None:
    loss = detectable([0.05] * SEEDS, SEEDS, tests, floor=0.0)
    found = sum(each.mean < 0 and each.beyond(tests * each.p_value, 0.0) for each in drawn(loss))
    assert found / DRAWS == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize("seeds", [3, 8])
def test_a_loss_that_is_stated_from_a_reruns_own_spread_is_found_in_three_of_four_runs(seeds: int) -> None:
    """Each baseline states its own loss, by the spread of its one rerun."""
    random, found = np.random.default_rng(seeds), 0
    for _ in range(800):
        noise = random.normal(0, 1, seeds).tolist()
        loss = detectable(noise, seeds, 12, floor=0.0)
        judged = Paired(random.normal(-loss, 1, seeds).tolist(), noise)
        found += judged.mean < 0 and judged.beyond(12 * judged.p_value, 0.0)
    assert found / 800 == pytest.approx(SIMULATED_POWER, abs=0.04)


def test_noise_of_many_reruns_gives_the_test_of_a_mean_with_known_spread() -> None:
    differences = [-0.4, -0.5, -0.3]
    far = Paired(differences, [0.1, -0.1] * 5000)
    sure = Paired(differences, [0.0])
    assert far.p_value < 1e-9
    assert sure.p_value > far.p_value


def test_a_rerun_that_has_the_same_spread_adds_its_degrees_of_freedom() -> None:
    differences = [-0.2, -0.1, -0.3]
    alone = ttest_1samp(differences, 0.0, alternative="less").pvalue
    with_rerun = Paired(differences, [0.1, -0.1, 0.1])
    assert with_rerun.freedom == 5
    assert 0 < with_rerun.p_value < alone


def test_a_loss_within_the_rerun_noise_is_not_found_however_steady() -> None:
    steady = Paired([-0.05] * 40, [0.06, -0.06] * 20)
    assert steady.p_value < ERROR_RATE
    assert not steady.beyond(steady.p_value, 0.0)
    assert not Paired([-0.05] * 3, [0.0] * 3).beyond(0.0, floor=0.1)


def test_a_single_seed_is_compared_with_the_rerun_alone() -> None:
    for size, found in ((0.9, False), (1.1, True)):
        assert Paired([-size * BAND * 0.1], [0.1]).beyond(Paired([-size * BAND * 0.1], [0.1]).p_value, 0.0) is found


def test_without_noise_every_difference_except_zero_counts() -> None:
    assert Paired([0.0, 0.0], [0.0, 0.0]).p_value == 1
    assert Paired([-0.1, -0.1], [0.0, 0.0]).p_value == 0
