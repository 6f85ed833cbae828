"""Stage 2 of every method on surfels: what its losses change, how far geometry moves, and what materials it finds."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
import torch

from baselines.methods.stage_two import CAPPED, GEOMETRY, STAGES, UNSEEN, changed_by, stepped, tensors_of, with_values
from known_ball import BALL, COLOUR, LOBE, SCENE, noise
from radiogs_baselines.methods.r3dg.model import before_softplus
from radiogs_core.learning.views import load
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.splatting import splat

METHODS = pytest.mark.parametrize("name", STAGES)
MOVABLE = pytest.mark.parametrize("name", ["gs-ir", "gi-gs", "irgs"])
"""Methods that may learn geometry in stage 2."""

MATERIALS = {"albedo_logit", "roughness_logit"}
METALS = {*MATERIALS, "metallic_logit"}
LOCAL = {"raw_environment", "local", "local_rest"}
VERTICES = {"vertex_albedo_logit", "vertex_roughness_logit"}
UNEVEN = ("albedo", "roughness", "metallic", "environment", "local", "offset")
"""Parts of the names of tensors that vary by position before a step, so that every loss has a gradient."""


@dataclass(frozen=True)
class Losses:
    """The tensors that each loss alone changes."""

    moved: Mapping[str, set[str]]
    """Names of tensors by weight."""
    surfels: Surfels | None = None
    """Surfels of the stage; None: the method's own."""
    turned: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the variant."""


LOSSES: Mapping[str, Losses] = {
    "gs-ir": Losses(
        {
            "shaded": {*METALS, *GEOMETRY, "log_environment", "irradiance"},
            "smoothness": {*METALS, *GEOMETRY},
            "prior": {"roughness_logit", "metallic_logit", *GEOMETRY},
            "light_smoothness": {"log_environment"},
        },
        CAPPED,
        {"metallic": True},
    ),
    "gi-gs": Losses(
        {
            "shaded": {*METALS, "log_environment"},
            "variation": METALS,
            "plainness": {"roughness_logit", "metallic_logit"},
            "light_smoothness": {"log_environment"},
        },
        turned={"metallic": True, "lr_scale": 0.0},
    ),
    "irgs": Losses(
        {
            "shaded": {*MATERIALS, "sh", "sh_rest", "log_environment"},
            "absolute": {"sh", "sh_rest"},
            "similarity": {"sh", "sh_rest"},
            "albedo_smoothness": {"albedo_logit"},
            "roughness_smoothness": {"roughness_logit"},
            "light_prior": {"log_environment"},
            "light_smoothness": {"log_environment"},
        },
        UNSEEN,
    ),
    "r3dg": Losses(
        {
            "absolute": MATERIALS | LOCAL,
            "similarity": MATERIALS | LOCAL,
            "albedo_smoothness": {"albedo_logit"},
            "roughness_smoothness": {"roughness_logit"},
            "irradiance_smoothness": LOCAL,
            "light_prior": LOCAL,
            "light_smoothness": {"raw_environment"},
        }
    ),
    "svg-ir": Losses(
        {
            "shaded": {*VERTICES, "log_environment", "ratio", "vertex_offset", "opacity_logit"},
            "radiance": {"sh", "sh_rest", "opacity_logit"},
            "consistency": {*VERTICES, "log_environment", "ratio"},
            "normal": {"vertex_offset", "opacity_logit"},
            "offset": {"vertex_offset"},
            "albedo_smoothness": {"vertex_albedo_logit", "opacity_logit"},
            "roughness_smoothness": {"vertex_roughness_logit", "opacity_logit"},
            "light_smoothness": {"log_environment"},
        }
    ),
}


def test_no_camera_sees_the_sheet_above_the_ball() -> None:
    for view in load(SCENE.train, torch.device("cpu")):
        assert not splat(view.camera, UNSEEN, {}, 1.0).touched[-1]


@pytest.mark.parametrize(
    ("name", "weight"), [(name, weight) for name, losses in LOSSES.items() for weight in losses.moved]
)
def test_each_loss_changes_the_parameters_it_depends_on(name: str, weight: str) -> None:
    two, losses = STAGES[name], LOSSES[name]
    stage = two.stage_of(two.variant(**{"materials": two.only(**{weight: 1.0}), **losses.turned}), losses.surfels)
    uneven = {
        tensor: value + noise(value, 0.3)
        for tensor, value in tensors_of(stage).items()
        if any(part in tensor for part in UNEVEN)
    }
    assert changed_by(with_values(stage, **uneven), 2) == losses.moved[weight]


@MOVABLE
@pytest.mark.parametrize("scale", [0.0, 0.5])
def test_geometry_is_frozen_without_a_rate(name: str, scale: float) -> None:
    """Only IRGS learns the surfels' own radiance."""
    two = STAGES[name]
    moved = changed_by(two.stage_of(two.variant(lr_scale=scale), LOSSES[name].surfels), 4)
    assert moved.intersection(GEOMETRY) == (set(GEOMETRY) if scale else set())
    assert moved >= {"albedo_logit", "roughness_logit", "log_environment"}
    assert bool(moved & {"sh", "sh_rest"}) == (name == "irgs")


def final_rates(rates: Any, factor: float = 1.0) -> dict[str, float]:
    """The rates at the end of stage 1; rotations and centres take longer steps in short runs."""
    return {
        "centre": factor * rates.position_end * SCENE.extent,
        "rotation": math.sqrt(factor) * rates.end_share * rates.rotation,
        "log_scale": rates.end_share * rates.scale,
        "opacity_logit": rates.end_share * rates.opacity,
    }


def initial_rates(rates: Any) -> dict[str, float]:
    """The rates at the beginning of stage 1."""
    return {
        "centre": rates.position * SCENE.extent,
        "rotation": rates.rotation,
        "log_scale": rates.scale,
        "opacity_logit": rates.opacity,
    }


RATES: Mapping[str, Callable[[Any], dict[str, float]]] = {
    "gs-ir": lambda rates: final_rates(rates, STAGES["gs-ir"].budget.geometry.rate),
    "gi-gs": final_rates,
    "irgs": initial_rates,
}


@MOVABLE
def test_geometry_moves_at_its_share_of_the_rates_of_stage_one(name: str) -> None:
    two = STAGES[name]
    stage = two.stage_of(two.variant(lr_scale=0.25))
    before, after = stepped(stage)
    for tensor, rate in RATES[name](stage.variant.geometry.rates).items():
        largest = float((after[tensor] - before[tensor]).abs().max())
        assert largest == pytest.approx(0.25 * rate, rel=0.05), f"{tensor}: Adam's first step is the rate itself"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "weight", "tensor"),
    [
        *(("gs-ir", "smoothness", tensor) for tensor in sorted(METALS)),
        *(("gi-gs", "variation", tensor) for tensor in sorted(METALS)),
        ("irgs", "albedo_smoothness", "albedo_logit"),
        ("irgs", "roughness_smoothness", "roughness_logit"),
        ("svg-ir", "albedo_smoothness", "vertex_albedo_logit"),
        ("svg-ir", "roughness_smoothness", "vertex_roughness_logit"),
    ],
)
def test_the_smoothness_losses_even_out_a_material(name: str, weight: str, tensor: str) -> None:
    two = STAGES[name]
    learning = two.only({"albedo": 0.05, "roughness": 0.05}, **{weight: 1.0})
    still = {"metallic": True, "lr_scale": 0.0} if "metallic_logit" in tensor or name in ("gs-ir", "gi-gs") else {}
    stage = two.stage_of(two.variant(materials=learning, **still))
    even = tensors_of(stage)[tensor]
    with_values(stage, **{tensor: even + noise(even, 1.0)})
    losses = [stage.step()[weight.replace("_", " ")] for _ in range(30)]
    assert sum(losses[-3:]) < 0.9 * sum(losses[:3]), "all three views, at the end and at the beginning"


@dataclass(frozen=True)
class Recovery:
    """A stage that learns albedo alone."""

    rates: Mapping[str, float]
    """Rates besides the rates of light and roughness, which are zero."""
    steps: int
    """Steps until the albedo is found."""
    turned: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the variant."""
    numbers: Mapping[str, int] = field(default_factory=dict)
    """Numbers of the budget."""
    weights: Mapping[str, float] | None = None
    """The only losses; None: all."""
    surfels: Surfels | None = None
    """Surfels of the stage; None: the method's own."""
    least: float = 0.01
    """Least change of the albedo of a surfel that was seen."""
    tolerance: float = 0.02
    """Largest error of the albedo."""


RECOVERIES: Mapping[str, Recovery] = {
    "gs-ir": Recovery({"albedo": 0.2}, 90, {"occlusion": False, "lr_scale": 0.0}),
    "gi-gs": Recovery({"albedo_end": 0.02}, 100, {"lr_scale": 0.0}, surfels=BALL),
    "irgs": Recovery({"albedo": 0.05}, 60, numbers={"pixels": 256, "incident_samples": 64}),
    "r3dg": Recovery({"albedo": 0.1}, 60, {"local_light": "none"}, {"incident_samples": 64}),
    "svg-ir": Recovery(
        {"albedo": 0.1, "ratio": 0.0},
        60,
        {"hop": 1e-3},
        {"incident_samples": 32},
        {"shaded": 1.0},
        least=0.3,
        tolerance=0.03,
    ),
}
"""GI-GS's own floor is not in the images."""


def material_of(stage: Any, name: str) -> torch.Tensor:
    """The albedo or roughness of each surfel; of one with vertices their mean."""
    model = stage.model
    return (getattr(model, name).mean(1) if hasattr(model, name) else getattr(model.surfels, name)).detach()


@pytest.mark.parametrize(
    "name", [pytest.param(each, marks=pytest.mark.slow if each == "irgs" else ()) for each in RECOVERIES]
)
def test_materials_are_recovered_under_known_light_and_shape(name: str) -> None:
    """Under a light of 1 the ball sends COLOUR, so its albedo is COLOUR minus the lobe for every initial value."""
    two, how = STAGES[name], RECOVERIES[name]
    rates = {"light": 0.0, "roughness": 0.0, **how.rates}
    learning = two.learning(rates) if how.weights is None else two.only(rates, **how.weights)
    if name == "gi-gs":
        learning = replace(learning, start=replace(learning.start, albedo=0.3))
    stage = two.stage_of(two.variant(materials=learning, **how.turned), how.surfels, two.numbered(**how.numbers))
    ones = torch.ones(8, 16, 3)
    light = {"raw_environment": before_softplus(ones)} if name == "r3dg" else {"log_environment": ones.log()}
    before = material_of(with_values(stage, **light), "albedo")
    for _ in range(how.steps):
        stage.step()
    after = material_of(stage, "albedo")
    seen = (after - before).abs().sum(-1) > how.least
    assert int(seen.sum()) > 50
    expected = torch.tensor(COLOUR) - LOBE
    torch.testing.assert_close(after[seen].median(0).values, expected, rtol=0, atol=how.tolerance)


@METHODS
def test_a_constant_start_has_the_exposure_and_the_materials_of_the_settings(name: str) -> None:
    stage = STAGES[name].stage_of()
    light, start = stage.model.environment.detach(), stage.variant.materials.start
    assert torch.equal(light, light[:1, :1].expand_as(light))
    assert start.light == "constant"
    for material in ("albedo", "roughness"):
        found = material_of(stage, material)
        torch.testing.assert_close(found, torch.full_like(found, getattr(start, material)))


@pytest.mark.slow
@METHODS
def test_the_shared_start_is_searched_for(name: str) -> None:
    stage = STAGES[name].stage_of(STAGES[name].method.variant(), BALL)
    assert float(stage.model.environment.detach().std()) > 1e-3
    assert float(material_of(stage, "albedo").std()) > 1e-3
