"""Maps that are kept and baselines for them: best constants, lights, views and surfels that the page shows."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from bench.fake_method import CPU
from bench.perfect import EVERYTHING, SCALE, Perfect, scene_of, view_with
from radiogs_bench.initial_viewpoint import InitialViewpoint
from radiogs_bench.scoring import report_arrays
from radiogs_bench.scoring.evaluate import Scope, evaluate
from radiogs_bench.scoring.metrics.conventions import Environment
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.report_arrays import LARGEST_HEIGHT, light_maps, surfel_arrays, views_to_keep
from radiogs_bench.scoring.score_maps import coverage, truth
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.surfels import Surfels
from radiogs_reports import maps

HALF_A_CODE = 0.5 / 255 + 1e-6
WITH_DEPTH = {**EVERYTHING, "depth": 1}


def scene(count: int = 4, **names: int) -> Scene:
    return scene_of(*(view_with(place, names or WITH_DEPTH) for place in range(count)))


def codes(model: Perfect, kept: int | None) -> dict[str, np.ndarray]:
    rules = protocol("default")
    found = evaluate(model, model.scene, rules, CPU, lambda done, total: None, Scope(timed=False, kept_views=kept))
    return {name: each for name, each in found.arrays.items() if name.startswith(maps.VIEWS)}


def test_codes_decode_to_the_maps_that_were_scored_and_to_their_truth() -> None:
    model = Perfect(scene())
    found = codes(model, 4)
    for place, view in enumerate(model.scene.test):
        for name in ("image", "albedo", "normal", "roughness", "indirect", "relit/sun", "relit/sky"):
            exact, seen = truth(view, name).numpy(), view.read("alpha").numpy() > 0
            for side in ("render", "truth"):
                decoded = maps.decoded(name, found[f"{maps.VIEWS}{place}/{side}/{name}"])
                shown = maps.kind_of(name).shown
                if name == "indirect":
                    decoded, wanted = maps.display(decoded), maps.display(exact)
                else:
                    decoded, wanted = shown(decoded), shown(exact)
                assert np.abs(decoded - wanted)[seen[..., 0]].max() <= HALF_A_CODE + 1e-3 * (name == "albedo"), name
    assert torch.allclose(model.scales[0], SCALE), "albedo is kept as it was aligned"


def test_normals_and_depths_say_where_there_is_no_surface() -> None:
    found = codes(Perfect(scene()), 4)
    bare = Perfect(scene()).scene.test[0].read("alpha").numpy()[..., 0] == 0
    for name, side in (("normal", "render"), ("normal", "truth"), ("depth", "render")):
        kept = found[f"views/0/{side}/{name}"]
        assert (kept[bare] == 0).all()
        assert (kept[~bare].max(-1) > 0).all()


def test_depth_is_kept_over_the_range_of_the_truth_whoever_renders_it() -> None:
    model = Perfect(scene())
    view = model.scene.test[0]
    exact = truth(view, "depth").numpy()[..., 0]
    seen = exact > 0
    low, high = exact[seen].min(), exact[seen].max()
    near, far = low - 0.1 * (high - low), high + 0.1 * (high - low)
    found = codes(model, 4)
    wanted = 255 * (1 - (exact - near) / (far - near))
    assert found["views/0/truth/depth"][..., 0][seen] == pytest.approx(wanted[seen], abs=0.501)
    rendered = found["views/0/render/depth"][..., 0]
    inside = seen & (view.read("alpha").numpy()[..., 0] > 0.5)
    assert (rendered[inside] > found["views/0/truth/depth"][..., 0][inside]).all(), "a third as far: in front of all"


def test_as_many_views_are_kept_as_asked_for_the_shown_one_among_them() -> None:
    many = scene(9, image=3)
    assert views_to_keep(many, 0) == frozenset()
    assert views_to_keep(many, 1) == {"view_4"}
    assert views_to_keep(many, 3) == {"view_1", "view_4", "view_7"}
    assert len(views_to_keep(many, 99)) == 9
    assert codes(Perfect(many), 0) == {}
    assert {name.split("/")[1] for name in codes(Perfect(many), 3)} == {"1", "4", "7"}


def test_without_a_number_as_many_are_kept_as_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A view has at most 14 channels of maps and 3 of each of two lights, predicted and true."""
    model, bytes_of_view = Perfect(scene(4)), 2 * (14 + 2 * 3) * 16 * 16
    assert len(views_to_keep(model.scene, None)) == 4
    monkeypatch.setattr(report_arrays, "KEPT_BYTES", 3 * bytes_of_view - 1)
    assert len(views_to_keep(model.scene, None)) == 2
    assert sum(each.nbytes for each in codes(model, None).values()) == 2 * bytes_of_view
    monkeypatch.setattr(report_arrays, "KEPT_BYTES", 1)
    assert views_to_keep(model.scene, None) == {"view_2"}


def test_metrics_do_not_depend_on_the_kept_views() -> None:
    rules, scenes = protocol("default"), scene()

    def metrics(kept: int | None) -> object:
        scope = Scope(timed=False, kept_views=kept)
        return evaluate(Perfect(scenes, {"image": 0.1}), scenes, rules, CPU, lambda done, total: None, scope).metrics

    assert metrics(0) == metrics(None)


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


def ramp(height: int) -> torch.Tensor:
    """Radiance that encodes its place: row, column, one."""
    rows = (torch.arange(height) + 0.5) / height
    columns = (torch.arange(2 * height) + 0.5) / (2 * height)
    return torch.stack([*torch.meshgrid(rows, columns, indexing="ij"), torch.ones(height, 2 * height)], -1)


def test_both_maps_have_the_size_and_the_orientation_of_the_truth() -> None:
    kept = light_maps(EnvironmentMap(ramp(16)), EnvironmentMap(ramp(16)))
    assert kept["truth/environment"].shape == (16, 32, 3)
    assert torch.equal(kept["truth/environment"], ramp(16))
    assert torch.allclose(kept["render/environment"], ramp(16), atol=1e-5)


def test_a_large_truth_is_averaged_and_keeps_a_sun_of_one_texel() -> None:
    true = torch.zeros(4 * LARGEST_HEIGHT, 8 * LARGEST_HEIGHT, 3)
    true[101, 333] = 1600.0
    kept = light_maps(EnvironmentMap(torch.ones(4, 8, 3)), EnvironmentMap(true))
    reduced = kept["truth/environment"]
    assert reduced.shape == (LARGEST_HEIGHT, 2 * LARGEST_HEIGHT, 3)
    assert reduced[25, 83].tolist() == pytest.approx([100.0] * 3)
    assert reduced.sum() == pytest.approx(300.0)
    assert torch.allclose(kept["render/environment"], torch.ones(()))


COUNT = 5
SEEN_FROM = InitialViewpoint(torch.tensor([3.0, 1.0, 2.0]), torch.tensor([0.0, 0.0, 1.0]))


class Bare:
    """A trained model that is made of something else."""

    light = None

    def facts(self) -> dict[str, Any]:
        return {}

    def export(self, folder: Path) -> list[Path]:
        return []

    def prepare(self, light: Any = None, albedo_scale: Any = None, after_step: Any = None) -> Any:
        raise AssertionError("it is not rendered here")


@dataclass
class Model(Bare):
    surfels: Surfels


@pytest.fixture
def surfels() -> Surfels:
    generator = torch.Generator().manual_seed(4)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    return Surfels(
        centre=random(COUNT, 3),
        rotation=random(COUNT, 4),
        log_scale=random(COUNT, 2) - 2,
        opacity_logit=random(COUNT),
        sh=0.2 * random(COUNT, 16, 3),
        albedo_logit=random(COUNT, 3),
        roughness_logit=random(COUNT),
    )


def test_arrays_hold_the_activated_parameters(surfels: Surfels) -> None:
    arrays = surfel_arrays(Model(surfels), SEEN_FROM, {})
    order = (surfels.opacity * surfels.scale.prod(-1)).argsort(descending=True)
    assert (arrays["surfels/centre"] == surfels.centre[order].numpy()).all()
    u, v = torch.from_numpy(arrays["surfels/tangents"]).unbind(1)
    assert torch.stack([u.norm(dim=-1), v.norm(dim=-1)], -1).allclose(surfels.scale[order])
    normal = torch.linalg.cross(u, v)
    assert (normal / normal.norm(dim=-1, keepdim=True)).allclose(surfels.frame[order][..., 2], atol=1e-6)
    constant = 0.28209479177387814 * surfels.sh[order, 0] + 0.5  # mean over all directions
    wanted = {
        "radiance": constant.clamp(min=0),
        "opacity": torch.sigmoid(surfels.opacity_logit[order]),
        "albedo": torch.sigmoid(surfels.albedo_logit[order]),
        "roughness": 0.05 + 0.95 * torch.sigmoid(surfels.roughness_logit[order]),
    }
    for name, values in wanted.items():
        assert arrays[f"surfels/{name}"] == pytest.approx(values.numpy(), abs=1e-3), name
    assert arrays["surfels/count"].tolist() == [COUNT]


def test_the_surfels_with_the_most_coverage_are_kept_of_a_large_model(
    surfels: Surfels, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_arrays, "MOST_SURFELS", 2)
    faint = replace(surfels, log_scale=torch.zeros(COUNT, 2), opacity_logit=torch.tensor([0.0, -9.0, 3.0, -9.0, 1.0]))
    arrays = surfel_arrays(Model(faint), SEEN_FROM, {})
    assert (arrays["surfels/centre"] == surfels.centre[[2, 4]].numpy()).all()
    assert arrays["surfels/count"].tolist() == [COUNT]


def test_radiance_beyond_half_precision_is_clipped_to_its_largest_number(surfels: Surfels) -> None:
    arrays = surfel_arrays(Model(replace(surfels, sh=surfels.sh + 1e6)), SEEN_FROM, {})
    assert np.isfinite(arrays["surfels/radiance"]).all()
    assert arrays["surfels/radiance"].min() == 65504


def test_models_without_surfels_have_no_arrays(surfels: Surfels) -> None:
    empty = Surfels.of({name: value[:0] for name, value in surfels.plain().items()})
    assert surfel_arrays(Model(empty), SEEN_FROM, {}) == {}
    assert surfel_arrays(Bare(), SEEN_FROM, {}) == {}


def test_the_initial_viewpoint_is_kept(surfels: Surfels) -> None:
    arrays = surfel_arrays(Model(surfels), SEEN_FROM, {})
    assert arrays["surfels/eye"].tolist() == [3.0, 1.0, 2.0]
    assert arrays["surfels/up"].tolist() == [0.0, 0.0, 1.0]
    assert "surfels/middle" not in arrays
    arrays = surfel_arrays(Model(surfels), replace(SEEN_FROM, middle=torch.tensor([1.0, 0.0, 0.5])), {})
    assert arrays["surfels/middle"].tolist() == [1.0, 0.0, 0.5]
