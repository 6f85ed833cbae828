"""Evaluation compares the right maps in the right form; a stand-in renders known images."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from bench.chain_method import Chain, Turned
from bench.fake_method import CPU
from bench.perfect import EVERYTHING, SCALE, SIZE, Own, Perfect, scene_of, view_with
from radiogs_bench.scoring.evaluate import Evaluation, evaluate
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.metrics.values import PSNR_CAP
from radiogs_bench.scoring.metrics_by_view import MetricsByView
from radiogs_bench.scoring.score_maps import displayed, score_view, truth
from radiogs_core.contract import NotOffered, Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View


class Fixed(Perfect):
    """Has light and surface in one, as a plain radiance field has."""

    def prepare(self, light: EnvironmentMap | None = None, *further: Any, **named: Any) -> Own:
        if light is not None:
            raise NotOffered("light and surface are one here")
        return Own(self)


def run_on(scene: Scene) -> Run:
    return Run(scene, Turned(), Chain.presets["smoke"], 0, CPU)


def scored(model: Any, rules: str = "default", scene: Scene | None = None) -> Evaluation:
    told: list[tuple[int, int]] = []
    result = evaluate(model, scene or model.scene, protocol(rules), CPU, lambda done, total: told.append((done, total)))
    assert told == [(step, told[-1][1]) for step in range(1, told[-1][1] + 1)]
    return result


def values(scene: Scene, wrong: Mapping[str, float] | None = None, rules: str = "default") -> Any:
    return scored(Perfect(scene, wrong), rules)


def test_a_perfect_model_has_perfect_metrics() -> None:
    scene = scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING), view_with(2, EVERYTHING))
    model = Perfect(scene)
    found = scored(model)
    for task in ("nvs", "albedo", "indirect", "relight"):
        assert found.metrics[f"{task}/psnr"]["value"] > 0.99 * PSNR_CAP
    assert found.metrics["normal/mae"]["value"] == pytest.approx(0.0, abs=1e-6)
    assert found.metrics["roughness/mse"]["value"] == pytest.approx(0.0, abs=1e-12)
    assert found.albedo_scale == pytest.approx(SCALE.tolist())
    assert all(torch.allclose(scale, SCALE) for scale in model.scales)
    assert found.views == ["view_0", "view_1", "view_2"]
    assert all(time > 0 for task in ("nvs", "render") for time in found.timings[f"{task}/ms"]["views"])


def test_evaluation_can_be_stopped_during_a_long_preparation() -> None:
    """Every step reports how many images are done, so that a request to stop need not wait for the last step."""
    told: list[tuple[int, int]] = []

    def advance(done: int, total: int) -> None:
        told.append((done, total))
        if told.count((done, total)) == 3:
            raise InterruptedError

    scene = scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING))
    with pytest.raises(InterruptedError):
        evaluate(Perfect(scene, steps=3), scene, protocol("default"), CPU, advance)
    assert told == [(1, 6), (2, 6), (2, 6), (2, 6)]


def test_the_memory_of_frames_is_the_most_that_any_light_took(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = iter([{"host": 3_000_000}, {"host": 5_000_000}, {"host": 4_000_000}])

    @contextmanager
    def peaks_within(device: torch.device) -> Iterator[dict[str, int]]:
        yield next(taken)

    monkeypatch.setattr("radiogs_bench.scoring.evaluate.peaks_within", peaks_within)
    timings = values(scene_of(view_with(0, EVERYTHING))).timings
    assert timings["nvs/megabytes"]["value"] == 3.0
    assert timings["render/megabytes"] == {"value": 5.0, "reason": None, "views": [None]}


def test_views_elsewhere_are_only_relit() -> None:
    """As in Stanford-ORB: each has its own light, and test views have none."""
    test = [view_with(place, {"image": 3, "normal": 3}) for place in range(2)]
    elsewhere = [view_with(2, {"relit/sun": 3}), view_with(3, {"relit/sky": 3})]
    scene = replace(scene_of(*test), relight=tuple(elsewhere))
    found = values(scene, {"relit/sun": 0.1, "relit/sky": 0.001, "image": 0.01})
    assert found.views == ["view_0", "view_1", "view_2", "view_3"]
    assert found.metrics["relight/psnr"]["value"] == pytest.approx((20 + 60) / 2, abs=1e-2)
    assert found.metrics["relight/psnr"]["views"] == [None, None, *map(partial(pytest.approx, abs=1e-2), (20, 60))]
    assert found.metrics["nvs/psnr"]["value"] == pytest.approx(40, abs=1e-3)
    assert found.metrics["nvs/psnr"]["views"][2:] == [None, None]
    assert found.metrics["normal/mae"]["value"] == pytest.approx(0, abs=1e-6)
    assert found.timings["render/ms"]["views"][:2] == [None, None]
    assert all(time > 0 for time in found.timings["render/ms"]["views"][2:])
    assert found.shown_light is None


def test_a_known_error_has_the_psnr_of_its_square() -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    found = values(scene, {"image": 0.01, "relit/sun": 0.1, "relit/sky": 0.001, "roughness": 0.02})
    assert found.metrics["nvs/psnr"]["value"] == pytest.approx(40.0, abs=1e-3)
    assert found.metrics["roughness/mse"]["value"] == pytest.approx(4e-4, rel=1e-4)
    # The mean over lights of 20 dB and 60 dB, not the PSNR of their mean error.
    assert found.metrics["relight/psnr"]["value"] == pytest.approx(40.0, abs=1e-2)


def test_indirect_light_is_compared_as_it_is_displayed() -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    found = values(scene, {"indirect": 0.05})
    true = truth(scene.test[0], "indirect").double().numpy()

    def encode(linear: np.ndarray) -> np.ndarray:
        return np.clip(np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055), 0, 1)

    error = np.mean((encode(true + 0.05) - encode(true)) ** 2)
    assert found.metrics["indirect/psnr"]["value"] == pytest.approx(-10 * math.log10(error), abs=1e-3)


def test_maps_without_truth_are_absent_and_maps_that_some_views_lack_are_named() -> None:
    some = {"image": 3, "normal": 3}
    found = values(scene_of(view_with(0, {"image": 3}), view_with(1, some)))
    assert {name.split("/")[0] for name in found.metrics} == {"nvs", "normal"}
    assert found.metrics["normal/mae"]["value"] is None
    assert found.metrics["normal/mae"]["reason"] == "not every test view has this ground truth"
    assert found.metrics["normal/mae"]["views"][0] is None
    assert found.albedo_scale is None
    assert found.shown_light is None


def test_the_arrays_hold_the_contact_sheets_maps() -> None:
    known = EVERYTHING | {"relit/sun/indirect": 3}
    scene = scene_of(view_with(0, known), view_with(1, known))
    found = values(scene)
    names = {
        "image", "albedo", "normal", "roughness", "indirect", "relit", "relit/sun", "relit/sky", "relit_indirect/sun",
    }  # fmt: skip
    assert found.arrays.keys() == {
        "render/incident",
        "render/incident_direct",
        *(f"{side}/{name}" for side in ("render", "truth") for name in names),
    }
    stored = scene.test[1].read("relit/sun/indirect").numpy()
    assert found.arrays["truth/relit_indirect/sun"] == pytest.approx(stored)
    assert (found.shown_view, found.shown_light) == ("view_1", "sun")
    for name in names:
        assert found.arrays[f"render/{name}"] == pytest.approx(found.arrays[f"truth/{name}"], abs=1e-6)
        assert found.arrays[f"render/{name}"].dtype == np.float32


def test_indirect_light_under_further_lights_is_not_shown_where_the_protocol_compares_what_arrives() -> None:
    known = EVERYTHING | {"relit/sun/indirect": 3}
    found = values(scene_of(view_with(0, known)), rules="radiogs")
    assert "render/relit/sun" in found.arrays
    assert not any("relit_indirect" in name for name in found.arrays)


def test_straight_maps_are_multiplied_by_coverage_once() -> None:
    view = view_with(0, EVERYTHING)
    alpha = view.read("alpha")
    for name in ("image", "albedo", "roughness", "relit/sun"):
        assert torch.equal(truth(view, name), view.read(name) * alpha)
    for name in ("normal", "indirect"):
        assert torch.equal(truth(view, name), view.read(name))


def test_a_view_without_alpha_is_covered_everywhere() -> None:
    view = view_with(0, EVERYTHING)
    opaque = View("v", view.camera, {"image": view.sources["image"]})
    assert torch.equal(truth(opaque, "image"), view.read("image"))


def test_depth_that_the_truth_lacks_is_not_compared() -> None:
    """A sensor's depth is zero where it knows nothing; half of this map is, and the prediction is 9 units off there."""
    depth = torch.full((SIZE, SIZE, 1), 2.0)
    depth[: SIZE // 2] = 0
    view = View("v", view_with(0, {}).camera, {"depth": lambda: depth})
    scores = MetricsByView(protocol("default"), ["v"])
    score_view(scores, view, {"depth": torch.where(depth > 0, depth + 0.5, 9.0)}, extent=10.0)
    assert scores.metrics()["depth/offset"]["value"] == pytest.approx(5.0)


def test_display_is_clipped() -> None:
    assert torch.equal(displayed(torch.tensor([[[-1.0, 0.0, 9.0]]])), torch.tensor([[[0.0, 0.0, 1.0]]]))


@pytest.mark.parametrize("rules", PROTOCOLS)
def test_every_protocol_has_a_value_or_a_reason_for_every_task(rules: str) -> None:
    model = Perfect(scene_of(*(view_with(place, EVERYTHING | {"depth": 1}) for place in range(2))), {"image": 0.01})
    found = scored(model, rules)
    of_shown = ["incident", "incident_direct"]  # of the view that is shown, always
    assert sorted(model.asked) == sorted([*of_shown, "incident"] if rules == "radiogs" else of_shown)
    tasks = {name.split("/")[0] for name in found.metrics}
    assert tasks >= {"nvs", "normal", "albedo", "roughness", "indirect", "relight"}
    for metric in found.metrics.values():
        assert (metric["value"] is None) == bool(metric["reason"])
    assert found.protocol["name"] == rules
    nvs = found.metrics["nvs/psnr_l" if rules == "stanford-orb" else "nvs/psnr"]["value"]
    assert nvs is not None
    assert 20 < nvs < 60


@pytest.mark.parametrize("rules", PROTOCOLS)
def test_a_method_that_cannot_be_relit_gives_its_reason_for_every_relit_metric(rules: str) -> None:
    """Nothing else is missing: the metrics are the same as for a relightable method, and progress counts all images."""
    scene = scene_of(*(view_with(place, EVERYTHING) for place in range(2)))
    found, able = scored(Fixed(scene), rules), scored(Perfect(scene), rules)
    assert found.metrics.keys() == able.metrics.keys()
    for name, metric in found.metrics.items():
        if name.startswith("relight/"):
            assert metric == {"value": None, "reason": "light and surface are one here", "views": [None, None]}
        else:
            assert metric == able.metrics[name]
    assert not [name for name in found.timings if name.startswith(("render/", "prepare/"))]
    assert not [name for name in found.arrays if "/relit" in name]
    assert (found.shown_light, able.shown_light) == (None, "sun")


def test_maps_that_a_method_does_not_offer_are_not_scored() -> None:
    scene = scene_of(*(view_with(place, EVERYTHING) for place in range(2)))
    found = scored(Chain(("fit",)).restore(run_on(scene), {"value": torch.zeros(1)}), scene=scene)
    assert {name.split("/")[0] for name in found.metrics} == {"nvs", "relight"}
    assert found.albedo_scale is None
    assert found.timings == {}  # it says that its seconds mean nothing


def test_a_protocol_that_relights_unscaled_does_so_and_reports_its_factor() -> None:
    model = Perfect(scene_of(view_with(0, EVERYTHING)))
    # Half of the pixels are covered by 0.6: their straight truth over what is rendered on black exceeds the factor, and
    # the median is the largest ratio of the other half, up to the rounding of 8 bits.
    assert scored(model, "gs-ir").albedo_scale == pytest.approx(SCALE.tolist(), rel=0.05)
    assert len(model.scales) == 2
    assert all(torch.equal(scale, torch.ones(3)) for scale in model.scales)


def test_depth_is_scored_up_to_its_scale_where_the_protocol_does() -> None:
    scene = scene_of(*(view_with(place, {"image": 3, "depth": 1}) for place in range(2)))
    found = values(scene, rules="stanford-orb").metrics["depth/simse"]
    assert found["value"] == pytest.approx(0, abs=1e-10)
    assert "depth/simse" not in values(scene).metrics


def test_the_recovered_light_is_compared_at_the_true_ones_resolution() -> None:
    scene = replace(scene_of(view_with(0, EVERYTHING)), training_light=EnvironmentMap(torch.full((8, 16, 3), 2.0)))
    light = EnvironmentMap(torch.tensor([1.0, 2.0, 5.0]).expand(2, 4, 3))
    found = scored(Perfect(scene, light=light)).metrics
    assert found["environment/error"]["value"] == pytest.approx((1 + 0 + 9) / 12)
    assert found["environment/error_scaled"]["value"] == pytest.approx(0, abs=1e-9)
    assert found["environment/error"]["views"] == [None]
    assert "environment/error" not in scored(Perfect(scene_of(view_with(0, EVERYTHING)), light=light)).metrics
    assert "environment/error" not in values(scene).metrics


def without_masks(scene: Scene) -> Scene:
    """The same images as photos of a room: the pixels of the object are not marked."""

    def photo(view: View) -> View:
        return replace(view, sources={name: read for name, read in view.sources.items() if name != "alpha"})

    return replace(scene, train=tuple(map(photo, scene.train)))


def test_light_and_albedo_of_a_scene_without_masks_are_withheld_with_the_reason() -> None:
    """Although all of it could be compared: the light of a room is part of its model."""
    light = EnvironmentMap(torch.ones(4, 8, 3))
    masked = replace(scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING)), training_light=light)
    lit, model = scored(Perfect(masked, light=light)), Perfect(without_masks(masked), light=light)
    found = scored(model)
    assert model.scales == [], "nothing was relit"
    assert found.albedo_scale is None
    assert found.shown_light is None
    for name in ("relight/psnr", "relight/ssim", "albedo/psnr", "environment/error", "environment/error_scaled"):
        assert lit.metrics[name]["value"] is not None
        assert found.metrics[name]["value"] is None
        assert "no masks" in (found.metrics[name]["reason"] or "")
    for name in ("nvs/psnr", "normal/mae"):
        assert found.metrics[name] == lit.metrics[name]
