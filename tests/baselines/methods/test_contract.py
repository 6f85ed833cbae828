"""The contract of every method: it is registered, its maps are as declared, and invalid lights are refused."""

import tomllib
from importlib import import_module
from pathlib import Path

import pytest
import torch

from baselines.methods.irgs.world import grey
from baselines.methods.tensoir.world import looking_down
from baselines.methods.trained_models import MODELS
from known_ball import SCENE
from radiogs_bench.methods import method
from radiogs_bench.sources import installed
from radiogs_bench.suites.baselines import PUBLISHED_METHODS
from radiogs_bench.suites.registry import suite
from radiogs_core.contract import Method, Prepared, Trained
from radiogs_core.errors import DataError
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelBudget

ARRIVING = {"gi-gs": ("incident",), **dict.fromkeys(("irgs", "r3dg", "svg-ir"), ("incident", "incident_direct"))}
"""Maps of incident light by method."""
"""Methods with a map of incident indirect light under the recovered light."""

BALL_SEEN, FLOOR_SEEN = SCENE.test[0].camera, looking_down(size=5)


def test_every_published_method_is_tested_here() -> None:
    assert {row.method for row in PUBLISHED_METHODS} == set(MODELS)


@pytest.mark.parametrize("name", MODELS)
def test_the_method_is_registered_and_implements_the_protocol(name: str) -> None:
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())
    module, _, attribute = project["project"]["entry-points"]["radiogs_bench.methods"][name].partition(":")
    ours = getattr(import_module(module), attribute)
    assert isinstance(ours, Method)
    assert ours.name == name
    assert method(name) is ours
    assert set(ours.presets) == {"smoke", "tiny", "small", "paper"}
    if name != "tensoir":
        assert all(
            isinstance(budget, SurfelBudget) and budget.geometry is GEOMETRY_PRESETS[preset]
            for preset, budget in ours.presets.items()
        ), "it has the shared stage 1"
    assert isinstance(MODELS[name](), Trained)


@pytest.mark.parametrize("name", MODELS)
def test_no_stage_depends_on_the_rendering_modules(name: str) -> None:
    """A reworded label or an additional map must not retrain a model: no stage's sources import such a module."""
    ours, sources = method(name), installed()
    core = ("radiogs_core.transport.maps", "radiogs_core.surfels.ply", "radiogs_core.on_surfels.trained")
    shows = {module for module in sources.closure(*ours.sources) if module.endswith("showing") or module in core}
    assert set(ours.sources) <= shows
    for stage in ours.stages(ours.variant(), ours.presets["smoke"]):
        assert not shows & set(sources.closure(*stage.sources)), stage.name


@pytest.mark.parametrize("name", MODELS)
def test_a_suite_has_rows_for_the_variants(name: str) -> None:
    rows = suite("tensoir-method" if name == "tensoir" else name).rows
    assert {row.method for row in rows} == {name}
    assert len(rows) > 1


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("relit", [False, True])
def test_maps_match_their_declaration(name: str, relit: bool) -> None:
    camera = FLOOR_SEEN if name == "tensoir" else BALL_SEEN
    shown = MODELS[name]().prepare(grey() if relit else None)
    assert isinstance(shown, Prepared)
    maps = shown.render(camera)
    assert set(maps) == shown.default
    for map_, value in maps.items():
        channels = 1 if map_ in ("alpha", "roughness", "depth") else 3
        assert value.shape == (camera.height, camera.width, channels), map_
        assert not value.requires_grad, map_
        outside = maps["alpha"][..., 0] == 0
        assert bool((value[outside] == 0).all()), map_
    length = maps["normal"].norm(dim=-1)[maps["alpha"][..., 0] > 0]
    torch.testing.assert_close(length, torch.ones_like(length))
    assert float(maps["image"].min()) >= 0
    assert float(maps["image"].max()) <= 1
    further = () if relit else ARRIVING.get(name, ())
    assert set(shown.offers) == {*shown.default, *further}
    with_incident = shown.render(camera, *further)
    assert set(with_incident) == {*shown.default, *further}
    assert all(float(with_incident[each].max()) > 0 for each in further)


@pytest.mark.parametrize("name", MODELS)
def test_a_light_with_a_broken_texel_is_refused(name: str) -> None:
    light = grey()
    light.radiance[1, 2, 0] = float("nan")
    with pytest.raises(DataError, match="1 texels of the environment map are not finite"):
        MODELS[name]().prepare(light)
