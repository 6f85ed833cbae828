"""Measured against published order: tau and its chance against all orders counted, its bounds by hand."""

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.stats import kendalltau, ttest_rel

from made_up_run import cell, in_every_form, run, summary
from radiogs_reports.analysis.published_order import Order, order_report, orders_of
from radiogs_reports.summary import Summary

SCENES = ("ball", "box", "bowl")
LEVEL = {"ball": 25.0, "box": 30.0, "bowl": 35.0, "ball2": 31.0}
"""Scenes differ by more than methods, so that only pairs resolve these."""


def made_up(
    gains: dict[str, tuple[float, ...]], published: dict[str, float], scenes: tuple[str, ...] = SCENES
) -> Summary:
    """A row for each method, with its gain over the level of each scene."""
    made = summary()
    made["rows"] = [{"key": key, "latex": "", "text": f"{key} & co", "seconds": 1.0} for key in gains]
    made["columns"], made["reference"], made["paper"], made["sheet"] = made["columns"][:2], None, [], []
    made["scenes"], made["seeds"] = [*scenes], [0]
    made["published"] = {key: {"nvs/psnr": value, "normal/mae": -value} for key, value in published.items()}
    made["cells"] = {key: {column["key"]: cell(30.0) for column in made["columns"]} for key in gains}
    made["runs"] = [
        one(key, scene, LEVEL[scene] + gain)
        for key, each in gains.items()
        for scene, gain in zip(scenes, each, strict=True)
    ]
    return made


def one(key: str, scene: str, psnr: float) -> Any:
    made = run(key, scene, 0, f"{key}{scene}", {"nvs/psnr": psnr, "normal/mae": -psnr})
    return {**made, "made_from": {**made["made_from"], "method": key}}


GAINS = {"a": (0.0, 0.1, 0.0), "b": (1.0, 1.2, 1.1), "c": (2.0, 2.1, 2.2), "d": (0.5, 3.0, 0.7)}


def orders(gains: dict[str, tuple[float, ...]], published: dict[str, float]) -> list[Order]:
    return orders_of(made_up(gains, published))


@pytest.mark.parametrize(
    ("measured", "published"),
    [
        ([1, 2, 3, 4], [10, 30, 20, 40]),
        ([1, 2, 3, 4], [1, 1, 2, 3]),
        ([1, 2, 3, 4, 5], [1, 2, 3, 4, 4]),
        ([1, 2, 3, 4], [3, 3, 3, 4]),
        ([1, 2, 2, 3, 4], [2, 1, 1, 4, 5]),
        ([2, 2, 1], [3, 1, 2]),
    ],
)
def test_tau_counts_pairs_in_order_and_chance_counts_all_orders(measured: list[float], published: list[float]) -> None:
    """Also with equal values on either side, which SciPy only approximates (.036 for the second's .083)."""
    keys = "abcde"[: len(measured)]
    psnr, normals = orders(
        {key: (float(gain),) * 3 for key, gain in zip(keys, measured, strict=True)},
        dict(zip(keys, map(float, published), strict=True)),
    )
    whole = kendalltau(measured, published).statistic
    every = [kendalltau(measured, order).statistic for order in itertools.permutations(published)]
    assert psnr.tau == pytest.approx(whole)
    assert psnr.by_chance == pytest.approx(np.mean([each >= whole - 1e-9 for each in every]))
    assert normals.tau == pytest.approx(whole), "lower is better in both"


def told_apart(gains: dict[str, tuple[float, ...]]) -> set[tuple[str, str]]:
    """Better and worse of the pairs that t tests over scenes tell apart, by Holm's steps."""
    pairs = list(itertools.combinations(gains, 2))
    tests = {pair: ttest_rel(gains[pair[0]], gains[pair[1]]) for pair in pairs}
    found = set()
    for place, pair in enumerate(sorted(pairs, key=lambda each: tests[each].pvalue)):
        if tests[pair].pvalue > 0.05 / (len(pairs) - place):
            break
        found.add(pair if tests[pair].statistic > 0 else pair[::-1])
    return found


def test_the_bounds_are_of_orders_that_exist() -> None:
    """Best against worst resolved, and nothing else: no order reverses both other pairs. All orders are counted."""
    random, narrower = np.random.default_rng(3), 0
    for _ in range(40):
        noise = random.choice([0.05, 0.3, 1.0], 4)
        gains = {key: tuple(place + random.normal(0, noise[place], 4)) for place, key in enumerate("abcd")}
        published = dict(zip("abcd", random.permutation([1.0, 2.0, 3.0, 3.0]).tolist(), strict=True))
        told = told_apart(gains)
        taus = [
            2 * sum(np.sign(published[better] - published[worse]) for better, worse in itertools.combinations(order, 2))
            for order in itertools.permutations("abcd")
            if all(order.index(better) < order.index(worse) for better, worse in told)
        ]
        scale = 2 * np.sqrt(6 * 5)
        psnr = orders_of(made_up(gains, published, (*SCENES, "ball2")))[0]
        assert (psnr.low, psnr.high) == pytest.approx((min(taus) / scale, max(taus) / scale))
        narrower += psnr.low > (2 * psnr.confirmed - 5) / np.sqrt(30) + 1e-9
    assert narrower


def test_the_bounds_are_a_point_where_every_scene_agrees_and_wide_where_they_differ() -> None:
    alike = {key: (float(place),) * 3 for place, key in enumerate(GAINS)}
    published = {key: float(place) for place, key in enumerate(GAINS)}
    assert [(o.tau, o.low, o.high) for o in orders(alike, published)] == [(1.0, 1.0, 1.0)] * 2
    psnr = orders({**alike, "d": (-9.0, 9.0, 9.0)}, published)[0]
    assert (psnr.confirmed, psnr.reversals) == (3, [])
    assert (psnr.low, psnr.high) == (0.0, 1.0), "three of six pairs are of the row whose scenes disagree"


def test_ties_among_published_values_leave_the_bounds_around_tau() -> None:
    alike = {key: (float(place),) * 3 for place, key in enumerate(GAINS)}
    psnr = orders(alike, {"a": 1.0, "b": 1.0, "c": 2.0, "d": 3.0})[0]
    assert psnr.low == pytest.approx(psnr.tau)
    assert psnr.high == pytest.approx(psnr.tau)


def test_only_resolved_pairs_are_called_reversed() -> None:
    made = made_up(GAINS, {"a": 40.0, "b": 30.0, "c": 20.0, "d": 10.0})
    report, psnr = order_report(made), orders_of(made)[0]
    assert report is not None
    assert {(each.better, each.worse) for each in psnr.reversals} == {("b", "a"), ("c", "a"), ("c", "b")}
    gain = next(each for each in psnr.reversals if (each.better, each.worse) == ("c", "b"))
    assert gain.gain.mean == pytest.approx(1.0)
    (sentence,) = [each for each in report.sentences if each.startswith("NVS PSNR, dB: c & co is better than b & co")]
    assert sentence.endswith("published the other way round, 20.00 and 30.00.")


def test_rows_of_one_method_count_once_and_two_methods_have_no_report() -> None:
    assert order_report(made_up({key: GAINS[key] for key in "ab"}, {"a": 1.0, "b": 2.0})) is None
    made = made_up(GAINS, dict.fromkeys(GAINS, 1.0))
    for each in made["runs"]:
        each["made_from"]["method"] = "one"
    assert order_report(made) is None


def test_one_scene_and_seed_resolves_no_pair() -> None:
    made = made_up({key: each[:1] for key, each in GAINS.items()}, {"a": 4, "b": 3, "c": 2, "d": 1}, ("ball",))
    report, psnr = order_report(made), orders_of(made)[0]
    assert report is not None
    assert (psnr.low, psnr.high, psnr.reversals) == (-1.0, 1.0, [])
    assert report.grids[0].rows[0][2].text == "-0.33"


def test_every_form_of_the_report_has_the_order() -> None:
    made = made_up(GAINS, {"a": 40.0, "b": 30.0, "c": 20.0, "d": 10.0})
    assert in_every_form(made, "published_order").reversed[0] == "b > a; c > a; c > b"
