"""Scores of constant maps, against a search for the best one."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from bench.fake_method import CPU
from bench.perfect import EVERYTHING, Perfect, scene_of, view_with
from radiogs_bench.scoring.evaluate import evaluate
from radiogs_bench.scoring.metrics.conventions import Environment
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.score_maps import coverage, truth
from radiogs_core.scene.light import EnvironmentMap


def light() -> EnvironmentMap:
    return EnvironmentMap(torch.rand(4, 8, 3, generator=torch.Generator().manual_seed(1)) ** 4)


@pytest.mark.parametrize("name", ["default", "radiogs"])
def test_the_best_constant_roughness_has_the_least_error_of_all_constants(name: str) -> None:
    scene, rules = scene_of(*(view_with(place, EVERYTHING) for place in range(3))), protocol(name)
    found = evaluate(Perfect(scene), scene, rules, CPU, lambda done, total: None).metrics["roughness/constant"]
    tried = [
        np.mean(
            [
                rules.score_roughness(constant * coverage(view), truth(view, "roughness"), coverage(view))["mse"].value
                for view in scene.test
            ]
        )
        for constant in np.linspace(0, 1, 401)
    ]
    assert found["value"] == pytest.approx(min(tried), rel=1e-4)
    assert found["value"] > 1e-3
    assert sum(each is not None for each in found["views"]) == 3


def test_the_best_constant_light_has_the_least_error_of_all_constants() -> None:
    true = light()
    scene = replace(scene_of(view_with(0, EVERYTHING)), training_light=true)
    grey = EnvironmentMap(torch.full((2, 4, 3), 0.7))
    for name in ("default", "stanford-orb"):
        found = evaluate(Perfect(scene, light=grey), scene, protocol(name), CPU, lambda done, total: None).metrics
        assert found["environment/error_scaled"]["value"] == pytest.approx(found["environment/constant"]["value"])
    assert 0.2 < found["environment/constant"]["value"] < 1


def test_the_best_constant_light_is_as_bright_as_the_true_one_on_the_whole() -> None:
    """No factor makes it better, so that a protocol that applies none gives it the same error."""
    scene = replace(scene_of(view_with(0, EVERYTHING)), training_light=light())
    found = [
        evaluate(Perfect(scene, light=light()), scene, rules, CPU, lambda done, total: None).metrics
        for rules in (protocol("default"), replace(protocol("default"), environment=Environment("none")))
    ]
    aligned, unaligned = (each["environment/constant"]["value"] for each in found)
    assert aligned == pytest.approx(unaligned)


def test_without_the_map_there_is_no_constant_to_compare_with() -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    plain = scene_of(view_with(0, {name: count for name, count in EVERYTHING.items() if name != "roughness"}))
    metrics = evaluate(Perfect(scene), scene, protocol("default"), CPU, lambda done, total: None).metrics
    assert "environment/constant" not in metrics, "no light was recovered, and none is known"
    assert "roughness/constant" not in evaluate(
        Perfect(plain), plain, protocol("default"), CPU, lambda done, total: None
    ).metrics  # fmt: skip


def test_the_mean_of_the_recovered_roughness_is_over_the_mask() -> None:
    whole = view_with(0, EVERYTHING)
    fainter = whole.read("alpha") * 0.6  # 0.6 and 0.36: the second is outside
    view = replace(whole, sources={**whole.sources, "alpha": lambda: fainter})
    scene = scene_of(view)
    found = evaluate(Perfect(scene, {"roughness": 0.25}), scene, protocol("default"), CPU, lambda done, total: None)
    mean = float((truth(view, "roughness") + 0.25)[coverage(view)[..., 0] > 0.5].mean())
    assert found.recovered == {"roughness": pytest.approx(mean, abs=1e-6)}
