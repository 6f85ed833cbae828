"""Evaluation compares the right maps in the right form; a stand-in renders known images."""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from bench.fake_method import CPU, FakeStage, fake_cell
from radiogs.model import Model
from radiogs_bench.evaluation import evaluate as module
from radiogs_bench.evaluation import frame_cost
from radiogs_bench.evaluation.evaluate import evaluate, incident_map
from radiogs_bench.evaluation.scoring import displayed, truth
from radiogs_bench.metrics import PROTOCOLS, PSNR_CAP
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splatting import splat
from scenes import look_at, sphere_scene

SIZE = 16
SCALE = torch.tensor([0.5, 2.0, 1.25])
MODEL = FakeStage(torch.zeros(3), 0.0, 0).model


def view_with(place: int, names: Mapping[str, int]) -> View:
    """A view whose maps are random, covered in its left three quarters, half of that by 60 %."""
    generator = torch.Generator().manual_seed(place)
    maps = {name: 0.1 + 0.4 * torch.rand(SIZE, SIZE, channels, generator=generator) for name, channels in names.items()}
    alpha = torch.zeros(SIZE, SIZE, 1)
    alpha[:, :12], alpha[:, :6] = 0.6, 1.0
    maps["alpha"] = alpha
    for name in ("direct", "indirect"):
        if name in maps:
            maps[name] = maps[name] * alpha
    if "normal" in maps:
        maps["normal"] = torch.nn.functional.normalize(maps["normal"], dim=-1) * (alpha > 0)
    camera = look_at(torch.tensor([4.0 + place, 0.0, 0.0]), torch.zeros(3), SIZE, 20.0)
    return View(f"view_{place}", camera, {name: (lambda image=image: image) for name, image in maps.items()})


EVERYTHING = {"image": 3, "albedo": 3, "normal": 3, "roughness": 1, "indirect": 3, "relit/sun": 3, "relit/sky": 3}


def scene_of(*views: View) -> Scene:
    lights = {name: EnvironmentMap(torch.ones(2, 4, 3)) for name in ("sun", "sky")}
    return Scene("s", "none", views, views, lights, None, "0")


class Perfect:
    """Renders the ground truth, but for what ``wrong`` adds to a map, and albedo divided by SCALE."""

    wrong: ClassVar[Mapping[str, float]]
    scene: ClassVar[Scene]
    scales: ClassVar[list[torch.Tensor]]
    incident: ClassVar[Incident] = Incident(*(torch.zeros(4, 5, *rest) for rest in ((3,), (), (), (3,))))

    def __init__(self, model: Model, *further: Any) -> None:
        self.light = None
        if len(further) > 2:  # as relit_under: light, albedo scale, run, after_step, share
            self.light = next(name for name, light in self.scene.lights.items() if light is further[0])
            self.scales.append(further[1])

    def render(self, camera: Any) -> dict[str, torch.Tensor]:
        views = (*self.scene.test, *self.scene.relight)
        view = next(view for view in views if torch.equal(view.camera.centre, camera.centre))
        if self.light is not None:
            name = f"relit/{self.light}"
            return {"image": truth(view, name) + self.wrong.get(name, 0.0), "alpha": view.read("alpha")}
        maps = {name: torch.zeros(SIZE, SIZE, channels) for name, channels in EVERYTHING.items() if "/" not in name}
        maps |= {name: truth(view, name) for name in maps if view.has(name)}
        maps["albedo"] = maps["albedo"] / SCALE
        depth = truth(view, "depth") if view.has("depth") else torch.zeros(SIZE, SIZE, 1)
        maps |= {"alpha": view.read("alpha"), "depth": depth / 3}
        return {name: image + self.wrong.get(name, 0.0) for name, image in maps.items()}


def values(
    scene: Scene,
    monkeypatch: pytest.MonkeyPatch,
    wrong: Mapping[str, float] | None = None,
    protocol: str = "default",
) -> Any:
    monkeypatch.setattr(Perfect, "scene", scene, raising=False)
    monkeypatch.setattr(Perfect, "wrong", wrong or {}, raising=False)
    monkeypatch.setattr(Perfect, "scales", [], raising=False)
    monkeypatch.setattr(module, "Renderer", Perfect)
    if module.incident_map is incident_map:  # the model of these tests has no surfels to splat
        monkeypatch.setattr(module, "incident_map", lambda model, incident, camera: torch.full((SIZE, SIZE, 3), 0.2))
    monkeypatch.setattr(module, "relit_under", Perfect)
    told: list[tuple[int, int]] = []
    cell = replace(fake_cell(), protocol=protocol)
    result = evaluate(MODEL, scene, cell, CPU, lambda done, total: told.append((done, total)))
    assert told == [(step, told[-1][1]) for step in range(1, told[-1][1] + 1)]
    return result


def test_a_perfect_model_has_perfect_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING), view_with(2, EVERYTHING))
    found = values(scene, monkeypatch)
    for task in ("nvs", "albedo", "indirect", "relight"):
        assert found.metrics[f"{task}/psnr"]["value"] > 0.99 * PSNR_CAP
    assert found.metrics["normal/mae"]["value"] == pytest.approx(0.0, abs=1e-6)
    assert found.metrics["roughness/mse"]["value"] == pytest.approx(0.0, abs=1e-12)
    assert found.albedo_scale == pytest.approx(SCALE.tolist())
    assert all(torch.allclose(scale, SCALE) for scale in Perfect.scales)
    assert found.views == ["view_0", "view_1", "view_2"]
    assert all(time > 0 for task in ("nvs", "render") for time in found.timings[f"{task}/ms"]["views"])


def test_evaluation_can_be_stopped_during_fine_tuning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every step tells how many images are done, so that a request to stop is not left waiting for the last step."""
    told: list[tuple[int, int]] = []

    def relight(model: Model, light: EnvironmentMap, *further: Any) -> Perfect:
        for _ in range(3):
            further[2]()
        return Perfect(model, light, *further)

    def advance(done: int, total: int) -> None:
        told.append((done, total))
        if told.count((done, total)) == 3:
            raise InterruptedError

    scene = scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING))
    values(scene, monkeypatch)
    monkeypatch.setattr(module, "relit_under", relight)
    with pytest.raises(InterruptedError):
        evaluate(MODEL, scene, fake_cell(), CPU, advance)
    assert told == [(1, 6), (2, 6), (2, 6), (2, 6)]


def test_the_memory_of_frames_is_the_most_that_any_light_took(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = iter([{"host": 3_000_000}, {"host": 5_000_000}, {"host": 4_000_000}])

    @contextmanager
    def peaks_within(device: torch.device) -> Iterator[dict[str, int]]:
        yield next(taken)

    monkeypatch.setattr(frame_cost, "peaks_within", peaks_within)
    timings = values(scene_of(view_with(0, EVERYTHING)), monkeypatch).timings
    assert timings["nvs/megabytes"]["value"] == 3.0
    assert timings["render/megabytes"] == {"value": 5.0, "reason": None, "views": [None]}


def test_views_elsewhere_are_relit_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """As Stanford-ORB has them: each under a light of its own, beside test views that are under none."""
    test = [view_with(place, {"image": 3, "normal": 3}) for place in range(2)]
    elsewhere = [view_with(2, {"relit/sun": 3}), view_with(3, {"relit/sky": 3})]
    scene = replace(scene_of(*test), relight=tuple(elsewhere))
    found = values(scene, monkeypatch, {"relit/sun": 0.1, "relit/sky": 0.001, "image": 0.01})
    assert found.views == ["view_0", "view_1", "view_2", "view_3"]
    assert found.metrics["relight/psnr"]["value"] == pytest.approx((20 + 60) / 2, abs=1e-2)
    assert found.metrics["relight/psnr"]["views"] == [None, None, *map(partial(pytest.approx, abs=1e-2), (20, 60))]
    assert found.metrics["nvs/psnr"]["value"] == pytest.approx(40, abs=1e-3)
    assert found.metrics["nvs/psnr"]["views"][2:] == [None, None]
    assert found.metrics["normal/mae"]["value"] == pytest.approx(0, abs=1e-6)
    assert found.timings["render/ms"]["views"][:2] == [None, None]
    assert all(time > 0 for time in found.timings["render/ms"]["views"][2:])
    assert found.shown_light is None


def test_a_known_error_has_the_psnr_of_its_square(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    found = values(scene, monkeypatch, {"image": 0.01, "relit/sun": 0.1, "relit/sky": 0.001, "roughness": 0.02})
    assert found.metrics["nvs/psnr"]["value"] == pytest.approx(40.0, abs=1e-3)
    assert found.metrics["roughness/mse"]["value"] == pytest.approx(4e-4, rel=1e-4)
    # The mean over lights of 20 dB and 60 dB, not the PSNR of their mean error.
    assert found.metrics["relight/psnr"]["value"] == pytest.approx(40.0, abs=1e-2)


def test_indirect_light_is_compared_as_it_is_displayed(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    found = values(scene, monkeypatch, {"indirect": 0.05})
    true = truth(scene.test[0], "indirect").double().numpy()

    def encode(linear: np.ndarray) -> np.ndarray:
        return np.clip(np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055), 0, 1)

    error = np.mean((encode(true + 0.05) - encode(true)) ** 2)
    assert found.metrics["indirect/psnr"]["value"] == pytest.approx(-10 * math.log10(error), abs=1e-3)


def test_what_a_scene_has_no_truth_for_is_absent_and_what_some_views_lack_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    some = {"image": 3, "normal": 3}
    found = values(scene_of(view_with(0, {"image": 3}), view_with(1, some)), monkeypatch)
    assert {name.split("/")[0] for name in found.metrics} == {"nvs", "normal"}
    assert found.metrics["normal/mae"]["value"] is None
    assert found.metrics["normal/mae"]["reason"] == "not every test view has this ground truth"
    assert found.metrics["normal/mae"]["views"][0] is None
    assert found.albedo_scale is None
    assert found.shown_light is None


def test_the_arrays_are_what_the_contact_sheet_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING))
    found = values(scene, monkeypatch)
    names = {"image", "albedo", "normal", "roughness", "indirect", "relit", "relit/sun", "relit/sky"}
    assert found.arrays.keys() == {
        "render/incident",
        *(f"{side}/{name}" for side in ("render", "truth") for name in names),
    }
    assert (found.shown_view, found.shown_light) == ("view_1", "sun")
    for name in names:
        assert found.arrays[f"render/{name}"] == pytest.approx(found.arrays[f"truth/{name}"], abs=1e-6)
        assert found.arrays[f"render/{name}"].dtype == np.float32


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


def test_display_is_clipped() -> None:
    assert torch.equal(displayed(torch.tensor([[[-1.0, 0.0, 9.0]]])), torch.tensor([[[0.0, 0.0, 1.0]]]))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_protocol_has_a_figure_or_a_reason_for_every_task(monkeypatch: pytest.MonkeyPatch, protocol: str) -> None:
    scene = scene_of(*(view_with(place, EVERYTHING | {"depth": 1}) for place in range(2)))
    seen: list[Incident] = []

    def incident_light(model: Model, incident: Incident, camera: Any) -> torch.Tensor:
        seen.append(incident)
        return torch.full((SIZE, SIZE, 3), 0.2)

    monkeypatch.setattr(module, "incident_map", incident_light)
    found = values(scene, monkeypatch, {"image": 0.01}, protocol)
    assert all(incident is Perfect.incident for incident in seen)
    assert len(seen) == (2 if protocol == "radiogs" else 1)  # of the view that is shown, always
    tasks = {name.split("/")[0] for name in found.metrics}
    assert tasks >= {"nvs", "normal", "albedo", "roughness", "indirect", "relight"}
    for metric in found.metrics.values():
        assert (metric["value"] is None) == bool(metric["reason"])
    assert found.protocol["name"] == protocol
    nvs = found.metrics["nvs/psnr_l" if protocol == "stanford-orb" else "nvs/psnr"]["value"]
    assert 20 < nvs < 60


def test_a_protocol_that_relights_unscaled_does_so_and_reports_its_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    found = values(scene, monkeypatch, protocol="gs-ir")
    assert found.albedo_scale == pytest.approx(SCALE.tolist(), rel=0.02)
    assert all(torch.equal(scale, torch.ones(3)) for scale in Perfect.scales)


def test_depth_is_scored_up_to_its_scale_where_the_protocol_does(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(*(view_with(place, {"image": 3, "depth": 1}) for place in range(2)))
    found = values(scene, monkeypatch, protocol="stanford-orb").metrics["depth/simse"]
    assert found["value"] == pytest.approx(0, abs=1e-10)
    assert "depth/simse" not in values(scene, monkeypatch).metrics


def test_the_released_indirect_light_is_the_hemispheres_mean_splatted() -> None:
    """A constant radiance from everywhere is itself times coverage, whatever the weights."""
    camera = sphere_scene().test[0].camera
    model = replace(MODEL, surfels=replace(MODEL.surfels, centre=torch.zeros(4, 3)))
    weight = torch.rand(4, 5)
    direction = torch.nn.functional.normalize(torch.randn(4, 5, 3), dim=-1)
    radiance = torch.tensor([0.2, 0.4, 0.8])
    incident = Incident(direction, weight, torch.zeros(4, 5), radiance.expand(4, 5, 3))
    alpha = splat(camera, model.surfels, {"any": torch.zeros(4, 1)}, depth_unit=1.0).alpha
    assert alpha.max() > 0.5
    torch.testing.assert_close(incident_map(model, incident, camera), alpha[..., None] * radiance)
    # Directions that stand for no solid angle do not count.
    incident.weight[:, 1:] = 0
    incident.radiance = torch.cat([radiance.expand(4, 1, 3), torch.rand(4, 4, 3)], 1)
    torch.testing.assert_close(incident_map(model, incident, camera), alpha[..., None] * radiance)


def test_the_recovered_light_is_compared_at_the_true_ones_resolution(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(scene_of(view_with(0, EVERYTHING)), training_light=EnvironmentMap(torch.full((8, 16, 3), 2.0)))
    monkeypatch.setattr(module.Model, "environment", torch.tensor([1.0, 2.0, 5.0]).expand(2, 4, 3))
    found = values(scene, monkeypatch).metrics
    assert found["environment/error"]["value"] == pytest.approx((1 + 0 + 9) / 12)
    assert found["environment/error_scaled"]["value"] == pytest.approx(0, abs=1e-9)
    assert found["environment/error"]["views"] == [None]
    assert "environment/error" not in values(scene_of(view_with(0, EVERYTHING)), monkeypatch).metrics
