"""The Pareto front holds the rows that are resolved to be better and costlier than the front's cheaper rows."""

import random

import pytest

from made_up_run import summary
from radiogs_reports.analysis.pareto import pareto_front, points
from radiogs_reports.analysis.samples import cost_of
from radiogs_reports.statistics import Origin, Sample


def seeds(*values: float) -> Sample:
    return {Origin("ball", seed): value for seed, value in enumerate(values)}


def alike(count: int) -> list[Sample]:
    """Costs that are 1, 2, 3 ... in each of three seeds, with a hundredth of noise."""
    return [seeds(*(place + noise for noise in (0.99, 1.0, 1.01))) for place in range(count)]


@pytest.mark.parametrize("units", [1, 3])
def test_without_two_resolved_rows_there_is_no_front(units: int) -> None:
    """A line through single values, or through the cheapest row alone, would be one through noise."""
    noise = [seeds(30.0, 31.0, 32.0), seeds(30.5, 30.9, 32.2), seeds(31.9, 30.0, 31.2)]
    costs, qualities = ([seeds(*list(each.values())[:units]) for each in made] for made in (alike(3), noise))
    assert pareto_front(costs, qualities, "up") == set()
    assert pareto_front(costs[:1], qualities[:1], "up") == set()


def test_the_front_holds_the_rows_that_are_resolved_to_be_better_and_to_cost_more() -> None:
    """For 30 rows of known order and little noise, the tests of all pairs give this order."""
    generator = random.Random(0)
    order = generator.sample(range(30), 30)
    samples = [seeds(*(10.0 * place + noise for noise in (-0.1, 0.0, 0.11))) for place in order]
    samples = [{at: value + generator.gauss(0, 1e-3) for at, value in each.items()} for each in samples]
    costs = [{at: value + generator.gauss(0, 1e-4) for at, value in each.items()} for each in alike(30)]
    expected = {place for place in range(30) if all(order[other] < order[place] for other in range(place))}
    assert len(expected) > 2
    assert pareto_front(costs, samples, "up") == expected
    downward = [{at: -value for at, value in each.items()} for each in samples]
    assert pareto_front(costs, downward, "down") == expected


def test_a_row_that_costs_more_and_is_better_by_noise_alone_is_not_on_the_front() -> None:
    cheap, best = seeds(30.0, 31.0, 32.0), seeds(33.0, 34.1, 35.0)
    by_noise, by_little = seeds(30.5, 30.9, 32.2), seeds(30.2, 31.21, 32.19)
    assert pareto_front(alike(3), [cheap, by_noise, best], "up") == {0, 2}
    assert pareto_front(alike(3), [cheap, by_little, best], "up") == {0, 1, 2}, "the same mean gain, resolved"


def test_of_rows_that_cost_alike_only_the_better_one_can_be_on_the_front() -> None:
    cheap, best, dear = seeds(30.0, 31.0, 32.0), seeds(33.0, 34.1, 35.0), seeds(36.0, 37.1, 38.2)
    by_noise = [seeds(1.0, 2.0, 3.0), seeds(1.4, 1.9, 2.8), seeds(9.0, 9.9, 11.1)]
    assert pareto_front(by_noise, [cheap, best, dear], "up") == {1, 2}
    assert pareto_front(by_noise[:2], [cheap, best], "up") == set(), "one row is no line"


def test_a_point_is_the_mean_cost_and_quality_of_a_row() -> None:
    made = summary()
    ours, no_rad = points(made, made["columns"][0], "seconds")
    assert (ours.row, ours.quality, ours.half_width) == ("ours", 31.234, None)
    assert ours.cost == pytest.approx(10 * 31 - 280 + 1)
    assert no_rad.half_width == pytest.approx(0.5)
    assert not ours.on_front, "a single pair of scene and seed tells nothing apart"


def test_rays_are_counted_over_both_stages_and_unknown_costs_are_no_points() -> None:
    made = summary()
    assert cost_of(made["runs"][0], "rays") == 1200
    assert cost_of(made["runs"][2], "rays") is None
    assert points(made, made["columns"][2], "seconds") == []  # no row has a value
