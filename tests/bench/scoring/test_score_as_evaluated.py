"""A model's own evaluation and ``score`` of the files that show the same give the same values under every protocol."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from bench.fake_method import CPU
from bench.perfect import KINDS, Perfect, name_of
from public_outputs import WRITERS, Maps, noisy
from radiogs_baselines.outputs.reading import read_predictions
from radiogs_bench.scoring.evaluate import SCORES_ALONE, evaluate
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.score_files import Score, score_predictions
from radiogs_core.contract import MapKind
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_decode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene


def with_floater(maps: Maps) -> Maps:
    """The maps at 0.9 of the coverage and with a half-covered patch where nothing is, in levels of 8 bits."""
    alpha = 0.9 * maps["alpha"]
    alpha[:6, :6] = 0.6
    shown: Maps = {"alpha": (alpha * 255).round() / 255, "normal": (maps["normal"] * 255).round() / 255}
    for name, image in maps.items():
        if name not in shown:
            covered = 0.9 * image
            covered[:6, :6] = 0.3
            shown[name] = (covered * 255).round() / 255
    return shown


class Shown:
    """Shows the same maps under its own light, and ``relit``'s maps under another."""

    timed = True

    def __init__(self, maps: Mapping[str, Maps], scene: Scene, light: str | None) -> None:
        self.maps, self.scene, self.light = maps, scene, light
        names = ("image", "alpha") if light else ("image", "alpha", "albedo", "indirect", "normal", "roughness")
        self.offers: Mapping[str, MapKind] = {name: KINDS[name] for name in names}
        self.default = frozenset(names)

    def render(self, camera: Camera, *further: str) -> dict[str, Tensor]:
        (view,) = [view for view in self.scene.test if torch.equal(view.camera.centre, camera.centre)]
        maps = self.maps[view.name]
        shown = {name: maps[name].clone() for name in self.offers}
        if self.light:
            return shown | {"image": maps[f"relit/{self.light}"]}
        shown["normal"] = torch.nn.functional.normalize(2 * maps["normal"] - 1, dim=-1) * (maps["alpha"] > 0)
        return shown | {"indirect": srgb_decode(maps["indirect"])}


class Predicting(Perfect):
    """Predicts given maps, whatever the factor of its albedo."""

    def __init__(self, scene: Scene, maps: Mapping[str, Maps]) -> None:
        super().__init__(scene)
        self.maps = maps

    def prepare(self, light: EnvironmentMap | None = None, *further: Any, **named: Any) -> Any:
        under = None if light is None else name_of(light, self.scene)
        return Shown(self.maps, self.scene, under)


@pytest.fixture(scope="module")
def scene() -> Scene:
    whole = load_scene("corner")
    return replace(whole, test=whole.test[:2])


@pytest.fixture(scope="module")
def predicted(scene: Scene) -> dict[str, Maps]:
    return {view: with_floater(maps) for view, maps in noisy(scene).items()}


@pytest.fixture(scope="module")
def scores(scene: Scene, predicted: dict[str, Maps], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Score]:
    """Scores of the files by protocol."""
    folder = tmp_path_factory.mktemp("plain")
    WRITERS["plain"](folder, predicted)
    found = score_predictions(read_predictions(folder, scene, "plain"), scene, list(PROTOCOLS.values()))
    return {score.protocol.name: score for score in found}


@pytest.mark.parametrize("name", list(PROTOCOLS))
def test_files_score_like_the_model_that_rendered_them(
    name: str, scene: Scene, predicted: dict[str, Maps], scores: dict[str, Score]
) -> None:
    model, files = Predicting(scene, predicted), scores[name]
    own = evaluate(model, scene, protocol(name), CPU, lambda done, total: None, scope=SCORES_ALONE)
    shared = {metric for metric, value in files.metrics.items() if value["value"] is not None}
    shared -= {metric for metric in shared if metric.startswith("relight/") and metric.count("/") > 1}
    assert {"nvs", "albedo", "relight"} <= {metric.split("/")[0] for metric in shared}
    for metric in sorted(shared):
        expected = own.metrics[metric]["value"]
        digits = 1e-3 if metric.startswith("albedo/") else 1e-4  # the files' albedo has half floats
        assert files.metrics[metric]["value"] == pytest.approx(expected, rel=digits, abs=1e-5), metric
    if files.albedo_scale is not None:
        assert files.albedo_scale == pytest.approx(own.albedo_scale, rel=1e-3), "half floats"
