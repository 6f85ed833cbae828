"""Every guard is documented in one place, counts itself where documented, and stays silent on a sound scene."""

import ast
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

import radiogs
import radiogs_core
from hard_cases.constructions import ball_of_surfels, cast, drawn, facing, looking_along_z, rays_along_z, with_radiance
from known_ball import BALL, SCENE
from radiogs_core.errors import ExplainedError
from radiogs_core.instruments import recording, require_finite
from radiogs_core.kernels.arguments import MOST_ENTRIES, require_countable
from radiogs_core.kernels.trace import topology
from radiogs_core.learning.views import load
from radiogs_core.on_surfels.light_start import SharedRays, light_and_albedo
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from scenes import look_at

CAMERA = looking_along_z()
LIST = Path(__file__).parents[3] / "docs/stability.md"
GUARDS = dict(re.findall(r"^\| `(\w+)` \|.*\| ([^|]*) \|$", LIST.read_text(), re.M))
"""How each guard acts, by name, as the documents list them."""


def fires_in_source() -> set[str]:
    """Names of all counters that the method's code adds to."""
    names: set[str] = set()
    for package in (radiogs_core, radiogs):
        assert package.__file__ is not None
        for file in Path(package.__file__).parent.rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "fire":
                    names |= {keyword.arg for keyword in node.keywords if keyword.arg}
    return names


def test_the_list_of_guards_is_what_the_code_counts() -> None:
    counted = {name for name, acts in GUARDS.items() if acts.startswith("it is counted")}
    assert fires_in_source() == counted == CASES.keys()


def broken(field: str) -> Callable[[], object]:
    def draw() -> object:
        given = {name: value.clone() for name, value in facing(torch.tensor([2.0, 3.0])).items()}
        given[field][0] = torch.nan
        return drawn(CAMERA, given)

    return draw


def too_deep() -> object:
    """A stack of two levels under a thousand surfels: within a real one no scene was found that needs more."""
    corner = torch.rand(1000, 3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(topology, "DEEPEST", 2)
        return topology.sah_topology(corner, corner)


def nothing_to_seek_light_in() -> object:
    views = tuple(replace(view, covered=torch.zeros_like(view.mask)) for view in load(SCENE.train, torch.device("cpu")))
    return light_and_albedo(SharedRays(BALL), views, 8, StartValues(), torch.Generator().manual_seed(0))


OPAQUE = facing(torch.tensor([2.0, 3.0]), 1.0)
CASES = {
    "degenerate_surfels": (broken("centre"), 1),
    "faint_surfels": (lambda: drawn(CAMERA, facing(torch.tensor([2.0, 3.0]), 1e-3)), 2),
    "saturable_surfels": (lambda: drawn(CAMERA, OPAQUE), 2),
    "full_rays": (lambda: cast(with_radiance(facing(torch.tensor([2.0, 3.0]), 0.9), 1), rays_along_z(5)), 5),
    "deep_trees": (too_deep, 1),
    "black_lights": (lambda: LightSampler(EnvironmentMap(torch.zeros(2, 4, 3))), 1),
    "lights_not_sought": (nothing_to_seek_light_in, 1),
    "broken_lights": (lambda: LightSampler(EnvironmentMap(torch.full((2, 4, 3), torch.nan))), 1),
    "blind_lenses": (lambda: replace(CAMERA, fx=0.0), 1),
    "bent_poses": (lambda: replace(CAMERA, camera_to_world=2 * torch.eye(4)), 1),
    "uncountable_lists": (lambda: require_countable(MOST_ENTRIES + 1, "things", ""), 1),
    "broken_colours": (broken("features"), 1),
    "broken_training": (lambda: require_finite("stage", 1, {"loss": torch.tensor(torch.nan)}), 1),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_a_guard_counts_how_often_it_acts(name: str) -> None:
    act, times = CASES[name]
    with recording() as instruments:
        if GUARDS[name].endswith("an error is raised"):
            with pytest.raises(ExplainedError):
                act()
        else:
            act()
    assert instruments.guards == {name: times}


def test_no_guard_acts_on_a_sound_scene() -> None:
    surfels = ball_of_surfels(60)
    surfels.opacity_logit = torch.full((60,), 1.0)
    camera = look_at(torch.tensor([0.0, -4.0, 0.5]), torch.zeros(3), 12, 15.0)
    with recording() as instruments:
        geometry = surfels.geometry_for(camera)
        given = {name: getattr(geometry, name) for name in ("centre", "axis_u", "axis_v", "normal", "opacity")}
        assert float(drawn(camera, given | {"features": surfels.albedo})[1].max()) > 0.5
    assert not instruments.guards
