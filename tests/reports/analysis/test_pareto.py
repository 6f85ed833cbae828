"""The Pareto front holds the rows that are resolved to be better than every cheaper row."""

import itertools
import random
from collections.abc import Sequence

import pytest

from made_up_run import summary
from radiogs_reports.analysis.pareto import pareto_front, points
from radiogs_reports.analysis.samples import cost_of
from radiogs_reports.statistics import Origin, Sample


def single(qualities: Sequence[float]) -> list[Sample]:
    """One pair of scene and seed each, so that values are compared as they are."""
    return [{Origin("ball", 0): quality} for quality in qualities]


def seeds(*values: float) -> Sample:
    return {Origin("ball", seed): value for seed, value in enumerate(values)}


def test_without_intervals_the_front_holds_the_pairs_that_no_other_dominates() -> None:
    generator = random.Random(0)
    costs = [float(cost) for cost in generator.sample(range(1000), 60)]
    qualities = [float(quality) for quality in generator.sample(range(1000), 60)]
    beaten = {
        place
        for (place, mine), (_, other) in itertools.permutations(enumerate(zip(costs, qualities, strict=True)), 2)
        if other[0] <= mine[0] and other[1] >= mine[1]
    }
    assert pareto_front(costs, single(qualities), "up") == set(range(60)) - beaten
    assert pareto_front(costs, single([-each for each in qualities]), "down") == set(range(60)) - beaten
    signs = [generator.choice((-1.0, 1.0)) for _ in costs]
    distances = [sign * (1000 - quality) for sign, quality in zip(signs, qualities, strict=True)]
    assert pareto_front(costs, single(distances), "zero") == set(range(60)) - beaten


def test_a_row_that_costs_more_and_is_better_by_noise_alone_is_not_on_the_front() -> None:
    cheap, best = seeds(30.0, 31.0, 32.0), seeds(33.0, 34.1, 35.0)
    by_noise, by_little = seeds(30.5, 30.9, 32.2), seeds(30.2, 31.21, 32.19)
    assert pareto_front([1.0, 2.0, 3.0], [cheap, by_noise, best], "up") == {0, 2}
    assert pareto_front([1.0, 2.0, 3.0], [cheap, by_little, best], "up") == {0, 1, 2}, "the same mean gain, resolved"
    assert pareto_front([1.0, 1.0], [cheap, best], "up") == {1}, "the better of equal cost"


def test_a_point_is_the_mean_cost_and_quality_of_a_row() -> None:
    made = summary()
    ours, no_rad = points(made, made["columns"][0], "seconds")
    assert (ours.row, ours.quality, ours.half_width) == ("ours", 31.234, None)
    assert ours.cost == pytest.approx(10 * 31 - 280 + 1)
    assert no_rad.half_width == pytest.approx(0.5)
    assert ours.on_front


def test_rays_are_counted_over_both_stages_and_unknown_costs_are_no_points() -> None:
    made = summary()
    assert cost_of(made["runs"][0], "rays") == 1200
    assert cost_of(made["runs"][2], "rays") is None
    assert points(made, made["columns"][2], "seconds") == []  # no row has a value
