"""A row can change every weight, rate, share and initial value, and each changes the stage that reads it."""

import json
from collections.abc import Iterator
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Any

import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.learning import MaterialLearning, MaterialStart
from radiogs.method import RADIOGS, inverse_rendering
from radiogs.settings import Variant
from radiogs_bench.sources import installed
from radiogs_core.contract import Run, StageSpec
from radiogs_core.errors import UsageError
from radiogs_core.learning.geometry import GeometryLearning
from radiogs_core.plain_values import PlainReader, with_values
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.starting_points import SurfelStart
from rooms import room_scene
from short_training import BUDGET, CPU, SCENE

OTHER = {
    "materials.start.search.white": 0.9,
    "geometry.schedule.distortion_from": 0.5,
    "geometry.schedule.degrees_from": (0.5,),
    "geometry.schedule.position_decay_until": 0.5,
    "geometry.density.start": 0.5,
    "geometry.density.end": 0.7,
    "geometry.density.gradient_threshold": 1.0,
    "geometry.density.clone_scale": 1.0,
    "geometry.density.largest_scale": 0.05,
    "geometry.density.opacity_floor": 0.6,
    "geometry.density.hidden_at": (0.5,),
    "geometry.density.least_contribution": 3.0,
    "geometry.schedule.decay_from": 0.1,
    "geometry.schedule.normal_late_from": 0.1,
    "geometry.schedule.normal_smoothness_until": 0.5,
    "geometry.density.prune_unseen": False,
    "geometry.density.resets.lower_every": 0.5,
    "geometry.density.resets.raise_every": 0.25,
    "geometry.density.resets.raise_to": 0.8,
    "geometry.density.resets.recovery": 9,
    "geometry.start.candidates": 64,
    "geometry.start.points": "swept",
    "geometry.schedule.moving_from": 0.5,
    "geometry.start.sweep.side": 8,
    "geometry.start.sweep.planes": 20,
    "geometry.start.sweep.neighbours": 1,
    "geometry.start.sweep.agreeing": 1,
    "geometry.start.sweep.window": 5,
    "geometry.start.sweep.step": 0.1,
    "geometry.start.sweep.jump": 0.0,
    "geometry.start.sweep.freest": 0.2,
    "geometry.start.sweep.fusions": 1,
    "geometry.start.sweep.opacity": 0.5,
    "geometry.surroundings.candidates": 4,
    "geometry.surroundings.compared": 1,
    "geometry.surroundings.width_quantile": 0.2,
    "geometry.surroundings.least_pixels": 4.0,
    "geometry.start.consistent_share": 0.3,
    "geometry.normal_target": "central",
    "geometry.across_silhouettes": True,
    "geometry.encoding": "premultiplied",
    "geometry.start.opacity": 0.3,
    "geometry.backgrounds": (0.5,),
    "geometry.colour": "display",
    "split_sum.consistency_from": 0.5,
    "split_sum.geometry_gradient": True,
    "materials.start.light": "constant",
    "materials.start.search.steps": 5,
    "materials.start.search.rows": 4,
    "materials.start.search.neighbours": 3,
    "materials.start.search.far": 3,
    "materials.start.search.far_share": 0.1,
    "materials.start.search.other_paint": 0.2,
    "materials.start.search.brightest": 0.5,
    "materials.start.search.colour": 0.02,
    "materials.directions.sets": 1,
    "materials.consistent_roughness": True,
    "materials.start.search.albedo_range": (0.1, 0.3),
    "materials.start.white": 0.4,
    "materials.start.brightest": 0.5,
    "materials.normal_from": 0.4,
    "materials.weights.distortion": 1.0,
    "materials.rates.light": 0.001,
    "materials.rates.length_power": 0.5,
    "materials.rates.roughness_length_power": 0.1,
    "finetuning.unit": "one",
    "finetuning.last_share": 0.5,
}
"""Test values of fields for which 1.5 times the default would have no effect in so short a run."""


# With fainter surfels no pixel becomes solid in so few steps, and without depth no normals are compared.
BASE = Variant(geometry=GeometryLearning(start=SurfelStart(points="hull", opacity=0.6)))


def leaves(of: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All fields that are not dataclasses, by dotted name."""
    for field in fields(of):
        value, name = getattr(of, field.name), f"{path}{field.name}"
        if is_dataclass(value):
            yield from leaves(value, f"{name}.")
        else:
            yield name, value


def turned(of: Any, path: str, value: Any) -> Any:
    """A copy with one field changed, as by a row of a suite."""
    first, _, rest = path.partition(".")
    return replace(of, **{first: turned(getattr(of, first), rest, value) if rest else value})


def other(path: str, value: Any) -> Any:
    return OTHER[path] if path in OTHER else 1.5 * value


def at(tree: Any, path: str) -> Any:
    for name in path.split("."):
        tree = tree[name]
    return tree


CONSTANT = replace(BASE, materials=MaterialLearning(start=MaterialStart(light="constant")))
OF_A_CONSTANT_START = (
    "materials.start.albedo", "materials.start.white", "materials.start.brightest", "materials.rates.constant_light",
    "materials.weights.light_prior", "materials.weights.light_smoothness",
)  # fmt: skip
"""Fields that matter only without a search for the light, or where the light is learnt."""

ROOM = {points: room_scene(views=8, size=16, points=points) for points in (0, 100)}

BASES = {
    "geometry.start.sweep.": {"geometry.start.points": "swept"},
    "geometry.schedule.moving_from": {"geometry.start.points": "swept"},
    "geometry.start.box": {"geometry.start.points": "box"},
    "geometry.density.prune_unseen": {
        "geometry.start.points": "box",
        "geometry.start.box": 4.0,
        "geometry.density.largest_scale": 10.0,
        "geometry.density.hidden_at": (),
    },
    "geometry.density.resets.": {
        "geometry.density.opacity_floor": 0.0,
        "geometry.density.resets.lower_every": 0.25,
        "geometry.density.resets.raise_every": 0.125,
        "geometry.density.resets.recovery": 1,
    },
}
"""Fields by the beginning of their names, with the values of others without which they have no effect."""

OF_A_FILE = "geometry.start.splat"
"""The beginning of the fields of a start from a file, which core/on_surfels/test_splat_start.py turns."""

LEAVES = {path: value for path, value in leaves(BASE) if not path.startswith(OF_A_FILE)}
OF_STAGE_ONE = [path for path in LEAVES if path.startswith(("geometry.", "split_sum."))]
OF_STAGE_TWO = [path for path in LEAVES if path.startswith("materials.")]


def initialised(variant: Variant, scene: Scene = SCENE) -> dict[str, Any]:
    stage = Initialisation(Run(scene, variant, BUDGET, 0, CPU))
    while stage.iteration < 18:
        stage.step()
    return stage.product()


@pytest.fixture(scope="module")
def first() -> dict[str, Any]:
    return initialised(BASE)


def inverted(first: dict[str, Any], variant: Variant) -> dict[str, torch.Tensor]:
    stage = inverse_rendering(Run(SCENE, variant, BUDGET, 0, CPU), first)
    while stage.iteration < 9:
        stage.step()
    return stage.optimiser.tensors


@pytest.fixture(scope="module")
def second(first: dict[str, Any]) -> dict[str, torch.Tensor]:
    return inverted(first, BASE)


def differ(some: dict[str, torch.Tensor], others: dict[str, torch.Tensor]) -> bool:
    return any(not torch.equal(value, others[name]) for name, value in some.items())


@pytest.mark.parametrize("path", OF_STAGE_ONE)
def test_each_field_of_geometry_and_split_sum_changes_stage_one(first: dict[str, Any], path: str) -> None:
    value, scene, before, base = other(path, LEAVES[path]), SCENE, first, BASE
    for beginning, needed in BASES.items():
        if path.startswith(beginning):
            base = with_values(BASE, needed)
            before = initialised(base)
    variant = turned(base, path, value)
    if path.startswith("geometry.surroundings."):
        scene = ROOM[0 if path == "geometry.surroundings.nearest" else 100]
        before = initialised(BASE, scene)
    assert differ(before["optimiser"]["tensors"], initialised(variant, scene)["optimiser"]["tensors"])
    for read in (variant.of_initialisation(), variant.of_training()):
        assert at(read, path) == value


@pytest.mark.parametrize("path", OF_STAGE_TWO)
def test_each_field_of_materials_changes_stage_two_alone(
    first: dict[str, Any], second: dict[str, torch.Tensor], path: str
) -> None:
    value, base = other(path, LEAVES[path]), BASE
    if path in OF_A_CONSTANT_START:
        base, second = CONSTANT, inverted(first, CONSTANT)
    variant = turned(base, path, value)
    assert differ(second, inverted(first, variant))
    assert at(variant.of_training(), path) == value
    assert variant.of_initialisation() == BASE.of_initialisation()


class Unread(MaterialLearning):
    def __post_init__(self) -> None:
        """Check no field: nothing may read one."""

    def __getattribute__(self, name: str) -> Any:
        assert name not in MaterialLearning.__dataclass_fields__, f"stage 1 reads {name}"
        return super().__getattribute__(name)


def test_stage_one_does_not_read_the_settings_of_materials(first: dict[str, Any]) -> None:
    """Runs that differ only in stage 2 share stage 1, so it must not depend on fields that its key leaves out."""
    blind = replace(BASE, materials=Unread())
    assert not differ(first["optimiser"]["tensors"], initialised(blind)["optimiser"]["tensors"])


READER = PlainReader("variant", "See its fields.")


def test_a_variant_is_hashable_and_survives_a_round_trip_through_json() -> None:
    variant = Variant(effects=("visibility",), deviations=("start-light",))
    variant = with_values(variant, {OF_A_FILE: "a.ply", f"{OF_A_FILE}_sha256": "0" * 64, f"{OF_A_FILE}_skips": 0.25})
    for path, value in LEAVES.items():
        if "." in path:
            variant = turned(variant, path, other(path, value))
    assert hash(variant) != hash(BASE)
    assert READER.build(Variant, json.loads(json.dumps(asdict(variant))), "") == variant


def test_a_nested_table_changes_one_field_and_keeps_the_others() -> None:
    variant = READER.build(Variant, {"materials": {"weights": {"mask": 0.5}}, "geometry": {"backgrounds": [0.0]}}, "")
    assert variant.materials.weights.mask == 0.5
    assert variant == turned(turned(Variant(), "materials.weights.mask", 0.5), "geometry.backgrounds", (0.0,))


def test_an_unknown_field_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UsageError, match=r"materials.weights: there is no field 'masks'\n.*'mask'"):
        READER.build(Variant, {"materials": {"weights": {"masks": 0.5}}}, "")


SHOWING = {
    "radiogs.showing",
    "radiogs.relighting",
    "radiogs.varying",
    "radiogs_core.surfels.ply",
    "radiogs_core.transport.maps",
}

STAGES = RADIOGS.stages(Variant(), RADIOGS.presets["smoke"])


@pytest.mark.parametrize("stage", STAGES, ids=[stage.name for stage in STAGES])
def test_the_sources_of_a_stage_exclude_the_modules_that_render(stage: StageSpec) -> None:
    assert not SHOWING & installed().closure(*stage.sources).keys()


def test_the_sources_of_the_method_include_the_modules_that_render() -> None:
    assert installed().closure(*RADIOGS.sources).keys() >= SHOWING
