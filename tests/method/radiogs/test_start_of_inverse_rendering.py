"""The light that stage 2 begins under: what its search simulates, and whether it is held or learnt."""

from typing import Any

import pytest
import torch

from radiogs.invert import InverseRendering
from radiogs.method import RADIOGS, inverse_rendering
from radiogs.settings import Variant
from radiogs.start import make_start
from radiogs_core.contract import Run
from radiogs_core.instruments import recording
from radiogs_core.plain_values import with_values
from short_training import BUDGET, CPU, SCENE, through_a_file


def begun(initialised: dict[str, Any], **changed: Any) -> InverseRendering:
    return inverse_rendering(Run(SCENE, with_values(Variant(), changed), BUDGET, 0, CPU), initialised)


@pytest.mark.parametrize(
    ("changed", "traces"),
    [
        ({}, True),
        ({"shading": "split-sum"}, False),
        ({"effects": ("specular",)}, False),
        ({"effects": ("visibility",)}, True),
        ({"effects": "auto"}, True),
    ],
    ids=["default", "split-sum", "specular", "visibility", "auto"],
)
def test_the_search_for_the_light_traces_rays_only_where_stage_2_does(
    initialised: dict[str, Any], changed: dict[str, Any], traces: bool
) -> None:
    with recording() as counted:
        start = begun(initialised, **changed).start
    assert not torch.equal(start.log_environment, start.log_environment.mean().expand_as(start.log_environment))
    assert (counted.work["rays"] > 0) == traces


SHORT = {"materials.start.search.steps": 3}
ALIKE: list[dict[str, Any]] = [
    {"radiometric_weight": 0.0}, {"detach": "pbr"}, {"incident": "precomputed"}, {"masking": "height-correlated"},
    {"deviations": ("fixed-offset", "hemisphere-floor", "light-detached"), "ray_offset": 0.1},
    {"effects": ("visibility", "indirect")}, {"materials.rates.light": 0.0005}, {"relighting": "surfels"},
]  # fmt: skip
OTHERS: list[dict[str, Any]] = [
    {"view_share": 0.5}, {"materials.start.roughness": 0.4}, {"materials.start.search.colour": 0.5},
    {"materials.start.light": "constant"}, {"deviations": ("start-light",)}, {"deviations": ("one-sided-rays",)},
    {"shading": "split-sum"}, {"effects": ("visibility",)}, {"effects": "auto"},
]  # fmt: skip


@pytest.mark.parametrize(("changed", "alike"), [*((each, True) for each in ALIKE), *((each, False) for each in OTHERS)])
def test_variants_share_a_start_exactly_if_it_is_the_same(
    initialised: dict[str, Any], changed: dict[str, Any], alike: bool
) -> None:
    whole, other = (with_values(Variant(), SHORT | some) for some in ({}, changed))
    starts = [RADIOGS.stages(variant, BUDGET)[1].start for variant in (whole, other)]
    made = [make_start(Run(SCENE, variant, BUDGET, 0, CPU), initialised) for variant in (whole, other)]
    assert (starts[0].reads == starts[1].reads) == alike
    assert same(*made) == alike


def same(one: Any, other: Any) -> bool:
    """Whether two products are equal to the last bit."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(value, other[name]) for name, value in one.items())
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else bool(one == other)


@pytest.mark.parametrize("effects", ["all", "auto"])
def test_stage_2_goes_on_from_a_stored_start_as_from_one_just_made(initialised: dict[str, Any], effects: str) -> None:
    run = Run(SCENE, with_values(Variant(), SHORT | {"effects": effects}), BUDGET, 0, CPU)
    spec = RADIOGS.stages(run.variant, run.budget)[1]
    whole = spec.begin(run, initialised)
    shared = spec.start.begin(run, through_a_file(spec.start.make(run, initialised)))
    for _ in range(2):
        assert shared.step() == whole.step()
    assert same(shared.state(), whole.state())


def test_stage_2_draws_other_random_numbers_than_its_start(initialised: dict[str, Any]) -> None:
    stage = begun(initialised, shading="split-sum")  # draws none while it begins
    fresh = torch.Generator().manual_seed(0)
    assert torch.equal(stage.generator.get_state(), make_start(stage_run(), initialised)["generator"])
    assert not torch.equal(stage.generator.get_state(), fresh.get_state())


def stage_run() -> Run:
    return Run(SCENE, with_values(Variant(), {"shading": "split-sum"}), BUDGET, 0, CPU)


@pytest.mark.parametrize(
    ("changed", "rate", "learnt"),
    [
        ({}, 0.0, False),
        ({"materials.rates.light": 0.0005}, 0.0005, True),
        ({"materials.start.light": "constant"}, 0.01, True),
        ({"deviations": ("start-light",)}, 0.01, True),
    ],
    ids=["searched", "searched-and-learnt", "constant", "start-light"],
)
def test_a_light_that_was_searched_for_is_held_and_a_constant_one_is_learnt(
    initialised: dict[str, Any], changed: dict[str, Any], rate: float, learnt: bool
) -> None:
    stage = begun(initialised, **changed)
    before = stage.model.log_environment.detach().clone()
    for _ in range(3):
        stage.step()
    assert stage.optimiser.rates["log_environment"] == rate
    assert (not torch.equal(stage.model.log_environment, before)) == learnt
