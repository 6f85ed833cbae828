"""The Pareto front holds exactly the rows that no other beats: judged by comparing every pair."""

import itertools
import random

import pytest

from made_up_run import summary
from radiogs_reports.analysis.pareto import pareto_front, points
from radiogs_reports.analysis.samples import cost_of


def test_the_pareto_front_holds_the_pairs_that_no_other_dominates() -> None:
    generator = random.Random(0)
    places = [(float(generator.randint(0, 9)), float(generator.randint(0, 9))) for _ in range(60)]
    beaten = {
        place
        for (place, mine), (_, other) in itertools.permutations(enumerate(places), 2)
        if other[0] <= mine[0] and other[1] >= mine[1] and (other[0] < mine[0] or other[1] > mine[1])
    }
    assert pareto_front(places, "up") == set(range(60)) - beaten
    assert pareto_front([(cost, -quality) for cost, quality in places], "down") == pareto_front(places, "up")
    signs = [generator.choice((-1.0, 1.0)) for _ in places]
    around = [(cost, sign * (9 - quality)) for sign, (cost, quality) in zip(signs, places, strict=True)]
    assert pareto_front(around, "zero") == pareto_front(places, "up")


def test_a_point_is_the_mean_cost_and_quality_of_a_row() -> None:
    made = summary()
    ours, no_rad = points(made, made["columns"][0], "seconds")
    assert (ours.row, ours.quality, ours.half_width) == ("ours", 31.234, None)
    assert ours.cost == pytest.approx(10 * 31 - 280 + 1)
    assert no_rad.half_width == pytest.approx(0.5)
    assert ours.on_front
    assert no_rad.on_front
    made["cells"]["no-rad"]["nvs/psnr"]["mean"] = 32.0
    assert [point.on_front for point in points(made, made["columns"][0], "seconds")] == [False, True]


def test_rays_are_counted_over_both_stages_and_unknown_costs_are_no_points() -> None:
    made = summary()
    assert cost_of(made["runs"][0], "rays") == 1040
    assert cost_of(made["runs"][2], "rays") is None
    assert points(made, made["columns"][2], "seconds") == []  # no row has a value
