"""Comparisons of rows: resolved differences, the rate of false ones, and the smallest resolvable difference."""

from collections.abc import Mapping
from typing import get_args

import numpy as np
import pytest
from scipy import stats

from made_up_run import summary
from radiogs_reports.analysis.comparisons import Direction, beaten, holm, ranks, to_reference
from radiogs_reports.analysis.pareto import pareto_front
from radiogs_reports.analysis.power import Plan, expected_difference, needed, planned, shift, smallest_difference
from radiogs_reports.statistics import Level, Origin, Sample, paired_difference, spread


def seeds(*values: float) -> Sample:
    return {Origin("ball", seed): value for seed, value in enumerate(values)}


LEVELS = (30.0, 33.0, 36.0)
"""By seed; the levels are so far apart that only paired differences resolve a decibel."""


def shifted(*by: float) -> Sample:
    return seeds(*(level + each for level, each in zip(LEVELS, by, strict=True)))


def test_holm_compares_the_smallest_with_all_and_the_largest_with_itself() -> None:
    assert holm({"a": 0.01, "b": 0.04, "c": 0.03}) == {"a": 0.03, "c": 0.06, "b": 0.06}
    assert holm({"a": 0.6, "b": 0.9}) == {"a": 1.0, "b": 1.0}


def test_a_difference_that_one_row_resolves_is_lost_among_many_rows() -> None:
    ours = shifted(0, 0, 0)
    close, noise = shifted(-1.0, -1.3, -0.8), shifted(1.0, -1.0, 0.3)
    alone = to_reference({"ours": ours, "row": close}, "ours", "up")
    assert alone["row"].verdict == "worse"
    many = {"ours": ours, "row": close} | {f"other{place}": noise for place in range(9)}
    assert to_reference(many, "ours", "up")["row"].verdict is None


@pytest.mark.parametrize(("direction", "expected"), [("up", "worse"), ("down", "better"), ("zero", "better")])
def test_verdicts_follow_the_direction_of_better_values(direction: Direction, expected: str) -> None:
    found = to_reference({"ours": shifted(0, 0, 0), "row": shifted(-1.0, -1.1, -0.9)}, "ours", direction)
    assert found["row"].verdict == expected
    assert found["row"].difference.mean == pytest.approx(-1.0)


def test_columns_without_a_direction_have_no_verdict() -> None:
    found = to_reference({"ours": shifted(0, 0, 0), "row": shifted(-1.0, -1.1, -0.9)}, "ours", "none")
    assert found["row"].verdict is None
    assert found["row"].p_value is not None


def test_a_row_ranks_behind_the_rows_that_are_resolved_to_be_better() -> None:
    rows = {"best": shifted(0.1, 0.0, 0.0), "close": shifted(-0.2, 0.1, 0.0), "worse": shifted(-9.0, -9.1, -8.9)}
    assert ranks(rows, "up") == {"best": 1, "close": 1, "worse": 3}
    turned = {row: {origin: -value for origin, value in sample.items()} for row, sample in rows.items()}
    assert ranks(turned, "down") == {"best": 1, "close": 1, "worse": 3}
    assert beaten(rows, "up") == {"best": {"worse"}, "close": {"worse"}, "worse": set()}


def test_no_row_of_noisy_values_ranks_before_a_better_mean() -> None:
    rows = {"best": shifted(0.1, 0.0, 0.0), "close": shifted(-1.0, -1.1, -0.9), "noisy": shifted(-90.0, 60.0, 0.0)}
    assert beaten(rows, "up") == {"best": {"close"}, "close": set(), "noisy": set()}
    assert ranks(rows, "up") == {"best": 1, "close": 2, "noisy": 2}


@pytest.mark.parametrize("direction", get_args(Direction))
def test_ranks_keep_the_order_of_means_whatever_the_noise(direction: Direction) -> None:
    rng, sign = np.random.default_rng(7), {"up": 1, "down": -1}
    for _ in range(40):
        rows = {f"row {each}": seeds(*rng.normal(each, 10 ** rng.uniform(-2, 1), 4)) for each in range(6)}
        ranked = ranks(rows, direction)
        merits = {row: np.mean([*sample.values()]) * sign.get(direction, 0) for row, sample in rows.items()}
        if direction == "zero":
            merits = {row: -abs(np.mean([*sample.values()])) for row, sample in rows.items()}
        assert all(ranked[a] <= ranked[b] for a in ranked for b in ranked if merits[a] > merits[b])
        assert bool(ranked) == (direction != "none")


def test_magnitudes_count_where_zero_is_best() -> None:
    assert ranks({"low": seeds(-3.0, -3.1, -2.9), "high": seeds(1.0, 1.1, 0.9)}, "zero") == {"high": 1, "low": 2}


def test_one_unit_resolves_nothing() -> None:
    assert ranks({"a": seeds(30.0), "b": seeds(10.0)}, "up") == {}
    assert ranks({"a": seeds(30.0, 31.0), "none": {}}, "up") == {}


@pytest.mark.parametrize("kinds", [1, 4])
def test_a_row_that_has_finished_on_one_of_several_scenes_is_not_judged_over_its_seeds(kinds: int) -> None:
    """With an interval over seeds, 47.5 % of such rows that do not differ in the mean had a verdict."""
    rng, places = np.random.default_rng(2), [(scene, seed) for scene in range(4) for seed in range(3)]
    ours, full, part = (
        {Origin(str(scene), seed, str(scene % kinds)): float(rng.normal(shift, 0.01)) + scene for scene, seed in places}
        for shift in (0.0, 0.5, 5.0)
    )
    part = {origin: value for origin, value in part.items() if origin.scene == "2"}
    found = to_reference({"ours": ours, "full": full, "part": part}, "ours", "up")
    units = [np.mean([full[at] - ours[at] for at in ours if at.scene == str(scene)]) for scene in range(4)]
    assert found["full"].p_value == pytest.approx(stats.ttest_1samp(units, 0).pvalue), "a family of one"
    assert (found["full"].difference.units, found["full"].verdict) == (4, "better")
    single = found["part"].difference
    assert (single.mean > 4, single.units, single.low, found["part"].verdict) == (True, 1, None, None)
    assert ranks({"ours": ours, "part": part, "full": full}, "up") == {"ours": 2, "part": 1, "full": 1}
    costs = [
        {origin: cost + 1e-3 * value for origin, value in each.items()}
        for cost, each in ((1, ours), (2, part), (3, full))
    ]
    assert pareto_front(costs, [ours, part, full], "up") == {0, 2}
    alone = {origin: value for origin, value in ours.items() if origin.scene == "2"}
    assert to_reference({"ours": alone, "part": part}, "ours", "up")["part"].verdict == "better", "a run of that scene"


@pytest.mark.parametrize(("units", "comparisons"), [(2, 1), (4, 1), (4, 6), (12, 10)])
def test_a_difference_of_the_smallest_size_is_resolved_in_four_of_five_runs(units: int, comparisons: int) -> None:
    rng = np.random.default_rng(units)
    drawn = rng.normal(shift(units, comparisons) / np.sqrt(units), 1.0, (20_000, units))
    p_values = stats.ttest_1samp(drawn, 0.0, axis=1).pvalue
    assert np.mean(p_values <= 0.05 / comparisons) == pytest.approx(0.8, abs=0.012)


def column(rng: np.random.Generator, plan: Plan, parts: Mapping[Level, float], rows: int) -> dict[str, Sample]:
    """A reference row of zeros and others that differ from it by nothing but the parts of the spread."""
    origins = [
        Origin(f"{kind}-{scene}", seed, str(kind))
        for kind in range(plan.kinds) for scene in range(plan.scenes) for seed in range(plan.seeds)
    ]  # fmt: skip
    samples: dict[str, Sample] = {"ours": dict.fromkeys(origins, 0.0)}
    for row in range(rows):
        kinds = rng.normal(0, parts["kinds"], plan.kinds)
        scenes = rng.normal(0, parts["scenes"], (plan.kinds, plan.scenes))
        samples[str(row)] = {
            origin: float(
                kinds[int(origin.kind)]
                + scenes[int(origin.kind), int(origin.scene.partition("-")[2])]
                + rng.normal(0, parts["seeds"])
            )
            for origin in origins
        }
    return samples


PARTS: dict[Level, float] = {"kinds": 0.0, "scenes": 1.0, "seeds": 0.5}


def test_a_plan_predicts_the_smallest_difference_of_its_runs() -> None:
    rng, plan = np.random.default_rng(5), Plan(1, 5, 3)
    squares = []
    for _ in range(300):
        compared = to_reference(column(rng, plan, PARTS, rows=1), "ours", "up")
        size = smallest_difference(compared)
        assert size is not None
        squares.append(size**2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(expected_difference(plan, PARTS, 1), rel=0.1)


def test_more_scenes_resolve_more_than_more_seeds() -> None:
    plan = Plan(1, 4, 3)
    now = expected_difference(plan, PARTS, 5)
    assert now is not None
    scenes = needed(now / 2, plan, PARTS, 5, "scenes")
    assert scenes is not None
    assert scenes > 4
    assert expected_difference(plan._replace(scenes=scenes), PARTS, 5) <= now / 2  # type: ignore[operator]
    assert expected_difference(plan._replace(scenes=scenes - 1), PARTS, 5) > now / 2  # type: ignore[operator]
    assert needed(now / 2, plan, PARTS, 5, "seeds") is None


def test_more_kinds_suffice_where_the_spread_of_scenes_is_unknown() -> None:
    parts: dict[Level, float] = {"kinds": 1.0}
    plan = Plan(2, 1, 1)
    kinds = needed(0.5, plan, parts, 1, "kinds")
    assert kinds is not None
    assert kinds > 10
    assert needed(0.5, plan, parts, 1, "scenes") is None


def test_a_plan_is_silent_where_the_stored_spread_is() -> None:
    assert expected_difference(Plan(1, 1, 1), PARTS, 2) is None
    assert expected_difference(Plan(1, 4, 1), {"seeds": 1.0}, 2) is None
    assert expected_difference(Plan(3, 4, 1), {"scenes": 1.0}, 2) is None
    assert smallest_difference({}) is None


def test_the_smallest_difference_is_the_typical_rows() -> None:
    rows = {
        "ours": shifted(0, 0, 0),
        "calm": shifted(0.1, 0, 0.1),
        "typical": shifted(1, 0, 1),
        "wild": shifted(9, 0, 9),
    }
    compared = to_reference(rows, "ours", "up")
    typical = paired_difference(rows["typical"], rows["ours"])
    assert typical is not None
    assert typical.deviation is not None
    expected = pytest.approx(shift(3, 3) * typical.deviation / np.sqrt(3))
    assert smallest_difference(compared) == expected
    with_one_untested = to_reference({**rows, "unfinished": seeds(30.5)}, "ours", "up")
    assert with_one_untested["unfinished"].p_value is None
    assert smallest_difference(with_one_untested) == expected, "a row that is not tested costs the others nothing"


def test_a_plan_reads_the_spread_of_a_stored_summary() -> None:
    made = summary()
    key = made["columns"][0]["key"]
    interval = made["cells"]["no-rad"][key]["difference"]
    assert interval is not None
    interval["spread"] = spread({Origin("a", 0): 0.0, Origin("a", 1): 1.0, Origin("b", 0): 2.0, Origin("b", 1): 5.0})
    found = next(each for each in planned(made, Plan(1, 3, 2), {key: 2.0}) if each.column["key"] == key)
    assert found.smallest == expected_difference(Plan(1, 3, 2), interval["spread"], 1)
    assert found.needed["scenes"] == needed(2.0, Plan(1, 3, 2), interval["spread"], 1, "scenes")
    others = [each for each in planned(made, Plan(1, 3, 2), {}) if each.column["key"] != key]
    assert all(each.wanted is None for each in others)
