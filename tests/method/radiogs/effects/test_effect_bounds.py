"""Bounds on what an effect changes."""

import math

import pytest
import torch

from radiogs.effects.bounds import RESAMPLES_PER_TAIL, bootstrap_t, resample_counts, sidak
from radiogs.effects.decision import GRADIENT_TOLERANCE, LEAST_SHARE, OFF_BELOW, Evidence, Measured, Tolerance, decide

LEVEL = 0.05
TRIALS = 300


def squared_normals(generator: torch.Generator) -> torch.Tensor:
    """A sample as skewed as squared errors, with mean 1."""
    return torch.randn(TRIALS, 120, generator=generator, dtype=torch.float64).square()


def mostly_zero(generator: torch.Generator) -> torch.Tensor:
    """A sample in which three of ten values are 1, with mean 0.3."""
    return (torch.rand(TRIALS, 120, generator=generator, dtype=torch.float64) < 0.3).double()


@pytest.mark.parametrize(("sample", "mean"), [(squared_normals, 1.0), (mostly_zero, 0.3)])
def test_each_bound_holds_with_the_probability_of_its_level(sample: object, mean: float) -> None:
    """Misses in 300 samples are binomial: 30 is five standard deviations above 15."""
    values = sample(torch.Generator().manual_seed(0))  # type: ignore[operator]
    generator = torch.Generator().manual_seed(1)
    bounds = [bootstrap_t(row[None], LEVEL, generator) for row in values]
    too_low = sum(float(above) < mean for _, above in bounds)
    too_high = sum(float(below) > mean for below, _ in bounds)
    assert too_low < 30
    assert too_high < 30
    # The bounds are not too wide: on average within a factor of two of the normal theory.
    theory = 1.645 * float(values.std(1).mean()) / math.sqrt(values.shape[1])
    width = sum(float(above) for _, above in bounds) / TRIALS - mean
    assert 0.5 * theory < width < 2 * theory


def test_statistics_have_the_same_bounds_together_and_alone() -> None:
    values = squared_normals(torch.Generator().manual_seed(3))[:2]
    below, above = bootstrap_t(values, LEVEL, torch.Generator().manual_seed(4))
    for index in range(2):
        alone = bootstrap_t(values[index : index + 1], LEVEL, torch.Generator().manual_seed(4))
        assert float(alone[0]) == pytest.approx(float(below[index]))
        assert float(alone[1]) == pytest.approx(float(above[index]))


def test_bounds_are_infinite_for_too_few_values() -> None:
    generator = torch.Generator().manual_seed(0)
    assert bootstrap_t(torch.ones(1, 1), LEVEL, generator)[1] == math.inf
    # Half of the resamples of two values are constant, so that the spread is not known.
    assert bootstrap_t(torch.tensor([[0.0, 1.0]]), LEVEL, generator)[1] == math.inf
    assert bootstrap_t(torch.full((1, 50), 2.0), LEVEL, generator)[1] == 2.0


def test_bounds_agree_with_explicit_resamples() -> None:
    level, count = 0.05, 12
    values = torch.rand(count, dtype=torch.float64, generator=torch.Generator().manual_seed(5)).square()
    mean, error = float(values.mean()), float(values.std()) / math.sqrt(count)
    resamples = math.ceil(RESAMPLES_PER_TAIL / level)
    ratios = []
    for times in resample_counts(count, resamples).int():
        resample = values.repeat_interleave(times)
        ratios.append((float(resample.mean()) - mean) / (float(resample.std()) / math.sqrt(count)))
    ratios.sort()
    low, high = bootstrap_t(values[None], level, torch.Generator())
    assert float(low) == pytest.approx(mean - ratios[-RESAMPLES_PER_TAIL] * error, rel=1e-9)
    assert float(high) == pytest.approx(mean - ratios[RESAMPLES_PER_TAIL - 1] * error, rel=1e-9)


def test_bounds_on_many_values_use_the_means_of_batches() -> None:
    values = torch.randn(1, 40_000, generator=torch.Generator().manual_seed(0), dtype=torch.float64).square()
    below, above = bootstrap_t(values, LEVEL, torch.Generator().manual_seed(1))
    theory = 1.645 * math.sqrt(2) / math.sqrt(values.shape[1])
    assert float(values.mean()) - 1.5 * theory < float(below) < float(values.mean()) < float(above)
    assert float(above) < float(values.mean()) + 1.5 * theory


def test_independent_comparisons_hold_together_with_the_stated_level() -> None:
    for count in (1, 7, 28):
        assert (1 - sidak(0.01, count)) ** count == pytest.approx(0.99)


def test_a_tolerance_in_decibels_converts_to_an_image_error() -> None:
    """The PSNR of images with errors of known correlation, in float64, agrees with the conversions."""
    generator = torch.Generator().manual_seed(0)
    error = 0.03 * torch.randn(400_000, generator=generator, dtype=torch.float64)
    tolerance = Tolerance(float(error.square().mean()))
    independent = torch.randn(400_000, generator=generator, dtype=torch.float64) * math.sqrt(tolerance.error)

    def loss(change: torch.Tensor) -> float:
        return 10 * math.log10(float((error + change).square().mean() / error.square().mean()))

    assert loss(independent) == pytest.approx(0.1, abs=0.01)
    assert tolerance.loss(tolerance.error) == pytest.approx(0.1)
    for scale in (1e-3, 0.02, 0.5):
        along = scale * error
        assert loss(along) == pytest.approx(tolerance.worst_case(float(along.square().mean())))
        assert loss(independent * scale) < tolerance.worst_case(float((independent * scale).square().mean()))
    assert Tolerance(0.0).loss(1e-9) == math.inf
    assert Tolerance(0.0).loss(0.0) == 0.0


HARMLESS = Measured(
    contribution=0.01, lowest=0.0, bound=0.02, worst=0.4, tail=0.1, gradient=0.1, share=0.3, rays=9000
)  # fmt: skip


def but(**changes: float) -> Measured:
    return Measured(**{**vars(HARMLESS), **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("measured", "was_off", "verdict"),
    [
        (HARMLESS, False, "off"),
        (None, False, "on"),
        (None, True, "on"),
        (but(bound=math.inf), True, "on"),
        (but(contribution=math.nan), True, "on"),
        (but(gradient=math.nan), True, "on"),
        (but(share=LEAST_SHARE / 2), False, "on"),
        (but(tail=1.2), False, "on"),
        # Hysteresis: between half the tolerance and the whole of it the state does not change.
        (but(bound=0.1 * OFF_BELOW - 1e-3), False, "off"),
        (but(bound=0.1 * OFF_BELOW + 1e-3), False, "on"),
        (but(bound=0.1 * OFF_BELOW + 1e-3), True, "off"),
        (but(bound=0.1 + 1e-3), True, "on"),
        (but(gradient=0.6 * GRADIENT_TOLERANCE), False, "on"),
        (but(gradient=0.6 * GRADIENT_TOLERANCE), True, "off"),
        (but(gradient=1.1 * GRADIENT_TOLERANCE), True, "on"),
    ],
)
def test_an_effect_is_left_out_only_if_it_matters_little_and_saves_work(
    measured: Measured | None, was_off: bool, verdict: str
) -> None:
    decision, why = decide(measured, was_off)
    assert decision == verdict
    assert why


def test_evidence_survives_a_round_trip_through_plain_values() -> None:
    for measured in (None, HARMLESS, but(bound=math.inf)):
        record = Evidence("visibility", "on", "because", 200, 7, 0.1, measured)
        assert Evidence.of(record.plain()) == record
