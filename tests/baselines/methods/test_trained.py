"""A trained model of every method: restored, shown under its own light and relit, exported, and described by labels."""

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from baselines.methods.adapters import same
from baselines.methods.irgs.world import grey
from baselines.methods.stage_two import STAGES, STANDING, UNSEEN
from baselines.methods.svg_ir.world import model_of as svg_ir_model
from baselines.methods.tensoir.world import looking_down, run_of
from baselines.methods.trained_models import FLOOR, LOW_ROOF, MODELS, gs_ir_model
from known_ball import SCENE
from radiogs_baselines.methods.gs_ir.metallic import MetallicSurfels
from radiogs_baselines.methods.r3dg.model import Model as R3DGModel
from radiogs_baselines.methods.tensoir.light import SphericalGaussians
from radiogs_baselines.methods.tensoir.model import Model as TensoIRModel
from radiogs_bench.methods import method
from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

EVERY = pytest.mark.parametrize("name", MODELS)


def camera(name: str, of_view: int = 0) -> Camera:
    """A camera that sees the method's model."""
    return looking_down(size=5 - of_view) if name == "tensoir" else SCENE.test[of_view].camera


def random_model(name: str) -> Any:
    """A model whose light, and whatever the method learns beside surfels, are random."""
    light = torch.randn(8, 16, 3)
    if name == "gs-ir":
        return gs_ir_model(log_environment=light, metallic_logit=torch.randn(len(LOW_ROOF)))
    if name == "svg-ir":
        model = svg_ir_model(LOW_ROOF, grey(), ratio=1.5)
        return replace(model, log_environment=light, vertex_offset=torch.randn_like(model.vertex_offset))
    return {
        "gi-gs": MetallicSurfels(STANDING, light, torch.randn(len(STANDING))),
        "irgs": LitSurfels(UNSEEN, light),
        "r3dg": R3DGModel(UNSEEN, torch.randn(len(UNSEEN), 16, 3), light),
        "tensoir": TensoIRModel(FLOOR, SphericalGaussians(torch.randn(5, 7))),
    }[name]


@EVERY
def test_the_model_and_its_light_are_restored_unchanged(name: str) -> None:
    stored = random_model(name)
    found = method(name).restore(run_of() if name == "tensoir" else STAGES[name].run_of(), stored.tensors())
    assert same(found.model.tensors(), stored.tensors())
    light = stored.light.environment().radiance if name == "tensoir" else stored.environment
    assert torch.equal(found.light.radiance, light)


@EVERY
def test_a_view_does_not_depend_on_views_rendered_before(name: str) -> None:
    light = grey()
    light.radiance[2, 3] = 5.0
    shown = MODELS[name]().prepare(light)
    first = shown.render(camera(name))["image"]
    shown.render(camera(name, 1))
    assert torch.equal(shown.render(camera(name))["image"], first)


@EVERY
def test_the_albedo_scale_applies_to_seen_surfaces(name: str) -> None:
    """The diffuse part grows in proportion; the lobe does not change."""
    one, two, three = (
        MODELS[name]().prepare(grey(0.5), torch.full((3,), scale)).render(camera(name)) for scale in (1.0, 2.0, 3.0)
    )
    torch.testing.assert_close(two["albedo"], 2 * one["albedo"])
    gain = two["direct"] - one["direct"]
    torch.testing.assert_close(three["direct"] - two["direct"], gain, rtol=1e-3, atol=1e-5)
    assert float(gain.max()) > 0


@pytest.mark.parametrize(
    ("name", "own", "relit"),
    [
        ("gi-gs", {"indirect": False}, {"relight_indirect": False}),
        ("irgs", {"indirect": "none"}, {"relight_indirect": False}),
        ("r3dg", {"local_light": "none"}, {"relight_local_light": False}),
        ("svg-ir", {"indirect": False}, {"relight_indirect": False}),
    ],
)
def test_indirect_light_is_switched_off_apart_under_the_recovered_light_and_relit(
    name: str, own: dict[str, Any], relit: dict[str, Any]
) -> None:
    def shown(light: EnvironmentMap | None, **turned: Any) -> Mapping[str, Tensor]:
        return MODELS[name](STAGES[name].variant(**turned)).prepare(light).render(camera(name))

    assert shown(None, **relit)["indirect"].any()
    assert not shown(None, **own)["indirect"].any()
    whole, without = shown(grey()), shown(grey(), **relit)
    assert whole["indirect"].any()
    assert not without["indirect"].any()
    assert torch.equal(without["direct"], whole["direct"])


@pytest.mark.parametrize("name", ["gs-ir", "gi-gs"])
@pytest.mark.parametrize("light", [None, grey(0.5)], ids=["recovered", "new"])
def test_lobes_have_the_masking_of_the_variant_which_is_the_exact_one_by_default(
    name: str, light: EnvironmentMap | None
) -> None:
    default, exact, approximate = (
        MODELS[name](STAGES[name].variant(**chosen)).prepare(light).render(camera(name))["direct"]
        for chosen in ({}, {"masking": "height-correlated"}, {"masking": "schlick"})
    )
    assert torch.equal(default, exact)
    assert float(exact.mean()) > 1.005 * float(approximate.mean())


@pytest.mark.parametrize("name", ["gs-ir", "gi-gs"])
def test_the_as_shipped_frame_turns_new_lights_alone(name: str) -> None:
    """A sky that is bright above lights what faces up, or another side; the recovered light has its own frame."""
    sky = grey(0.0)
    sky.radiance[:2] = 1.0
    plain, turned = MODELS[name](), MODELS[name](STAGES[name].variant(frame="as_shipped"))
    oriented, shipped = (each.prepare(sky).render(camera(name)) for each in (plain, turned))
    up = oriented["normal"][..., 2] > 0.95
    assert float(oriented["direct"][up].mean()) > 2 * float(shipped["direct"][up].mean())
    own, other = (each.prepare().render(camera(name))["image"] for each in (plain, turned))
    assert torch.equal(own, other)


EXPORTED = {
    "gs-ir": ["surfels.ply", "volumes.npz"],
    "r3dg": ["surfels.ply", "local_light.npy"],
    "tensoir": ["field.npz"],
}
"""Names of exported files; of the other methods the surfels alone."""


@EVERY
def test_export_writes_the_model(name: str, tmp_path: Path) -> None:
    files = MODELS[name]().export(tmp_path)
    assert [path.name for path in files] == EXPORTED.get(name, ["surfels.ply"])
    assert all(path.stat().st_size > 0 for path in files)


def labels(name: str, turned: Mapping[str, Any], extent: float = 1.0, **numbers: Any) -> dict[str, str]:
    """Labels of a variant at the preset paper with some numbers changed."""
    showing, ours = import_module(f"radiogs_baselines.methods.{name.replace('-', '_')}.showing"), method(name)
    given = ours.variant(**turned), replace(ours.presets["paper"], **numbers)
    found: dict[str, str] = showing.labels_of(*given) if name == "tensoir" else showing.labels_of(*given, extent)
    return found


@pytest.mark.parametrize(
    ("name", "number", "published"),
    [
        ("gs-ir", "occlusion_samples", 256),
        ("gi-gs", "azimuths", 32),
        ("irgs", "incident_samples", 256),
        ("r3dg", "incident_samples", 64),
        ("svg-ir", "incident_samples", 64),
        ("tensoir", "grid_end", 300),
    ],
)
def test_facts_list_reduced_settings_and_replacements(name: str, number: str, published: int) -> None:
    trained = MODELS[name]()
    facts = trained.facts()
    if name == "tensoir":
        assert facts["grid"] == FLOOR.size
    else:
        assert facts["surfels"] == len(trained.model.surfels)  # type: ignore[attr-defined]
        assert facts["labels"]["stage1"].startswith("shared")
    own = getattr(trained.run.budget, number)  # type: ignore[attr-defined]
    assert f"{number} {own} (published: {published})" in facts["labels"]["reduced"]
    assert facts["remarks"] == [f"{label}: {text}" for label, text in facts["labels"].items()]
    assert "reduced" not in labels(name, {})
    assert labels(name, {}, **{number: 3})["reduced"] == f"{number} 3 (published: {published})"


SHIPPED = {"frame": "as_shipped"}


@pytest.mark.parametrize(
    ("name", "turned", "numbers", "label", "text"),
    [
        ("gs-ir", {}, {"extent": 4.545}, "tau", "0.25 world units (published: 0.25)"),
        ("gs-ir", {"tau": None}, {}, "tau", "none: occluders at any distance"),
        ("gs-ir", {"occlusion": False}, {}, "tau", None),
        ("gs-ir", {"nearest": 0.044}, {"extent": 4.545}, "nearest", "0.2 world units"),
        ("gs-ir", {}, {}, "lr_scale", None),
        ("gs-ir", {"lr_scale": 0.0}, {}, "lr_scale", "0 of"),
        ("gs-ir", SHIPPED, {}, "relight_frame", "Y-up lookup of new lights along Z-up directions, as published"),
        ("gi-gs", {}, {"extent": 4.55}, "lengths", "radius 0.801 (published: 0.8)"),
        ("gi-gs", {}, {"extent": 4.55}, "lengths", "thick 0.05 (published: 0.05)"),
        ("gi-gs", {}, {}, "geometry", "moved in stage 2"),
        ("gi-gs", {"lr_scale": 0.0}, {}, "geometry", "frozen"),
        ("gi-gs", {}, {}, "start", "at 8 of 16"),
        ("gi-gs", {"readme_bug": True}, {}, "start", "at 64 in training"),
        ("gi-gs", {}, {}, "relight_frame", "light maps as their files say"),
        ("gi-gs", SHIPPED, {}, "relight_frame", "light maps with Y up"),
        ("irgs", {}, {}, "lr_scale", None),
        ("irgs", {"lr_scale": 0.1}, {}, "lr_scale", "0.1 (published scripts: 0)"),
        ("irgs", {"ray_start": 0.01}, {"extent": 5.0}, "ray_start", "0.05 world units (published: 0.05)"),
        ("r3dg", {}, {}, "local_rate", None),
        ("r3dg", {}, {"local_rate": 2.0}, "local_rate", "2 times"),
        ("r3dg", {"ray_start": 0.01}, {"extent": 5.0}, "ray_start", "0.05 world units (published: 0.06)"),
        ("r3dg", {"floor": True}, {}, "directions", "none below 10 degrees, as published"),
        ("svg-ir", {"attributes": "constant"}, {}, "attributes", "constant-attribute"),
        ("svg-ir", {}, {"extent": 5.0}, "hop", "0.22 world units (published: 0.2)"),
        ("svg-ir", {"hop": None}, {}, "hop", "full length"),
        ("svg-ir", {}, {"consistency_surfels": 9}, "reduced", "consistency_surfels 9 (published: all)"),
        ("tensoir", {}, {}, "ray_start", None),
        ("tensoir", {}, {}, "network_rate", None),
        ("tensoir", {}, {"network_rate": 2.0}, "network_rate", "2 times"),
        ("tensoir", {}, {"grid_end": 64}, "ray_start", "published: 0.05"),
        ("tensoir", {"shown": "shaded"}, {}, "nvs", "images under the recovered light are shaded"),
    ],
)
def test_labels_describe_the_variant_and_the_budget(
    name: str, turned: dict[str, Any], numbers: dict[str, Any], label: str, text: str | None
) -> None:
    found = labels(name, turned, **numbers).get(label)
    assert found is None if text is None else text in (found or "")
