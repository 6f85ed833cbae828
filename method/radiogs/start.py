"""The materials and light with which stage 2 begins, for the surfels of stage 1.

Most of the time that stage 2 takes to begin goes into the search for the light (``light_start``). Its result depends on
few settings, ``StartSettings``; variants that agree in them share it (``contract.SharedStart``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from radiogs_core.contract import Run
from radiogs_core.learning.views import chosen_views, load
from radiogs_core.on_surfels.fit_geometry import surfels_of
from radiogs_core.on_surfels.light_start import SharedRays, StartingModel, starting_model
from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.on_surfels.start_values import StartValues
from radiogs_core.transport.plan import EffectPlan, plan_of

from .model import constant_light
from .oracle import given_geometry
from .rays import RaySettings
from .settings import START_RADIANCE, Budget, Variant

SUN_ROWS = 256
"""Rows of the light map if suns are found: a texel of .7 degrees."""


@dataclass(frozen=True)
class StartSettings:
    """Everything that the start reads from variant and budget."""

    view_share: float
    """Share of the training views."""
    light_height: int
    """Rows of the light map."""
    values: StartValues
    """Initial values, and the settings of the search."""
    released: bool
    """Whether the light starts as with the deviation ``start-light``."""
    true_geometry: bool
    """Whether true surfels replace the learnt ones."""
    two_sided: bool
    """Whether rays hit surfels from behind."""
    visibility: bool
    """Whether the search simulates visibility."""
    indirect: bool
    """Whether the search simulates indirect light."""
    probed: bool
    """Whether the model of stage 1 is kept for a probe of effects before the first step."""

    @classmethod
    def of(cls, variant: Variant, budget: Budget) -> "StartSettings":
        """The settings of a run.

        The search simulates what stage 2 simulates: split-sum shading has neither visibility nor indirect light.
        """
        plan = plan_of(() if variant.shading == "split-sum" else variant.effects)
        return cls(
            view_share=variant.view_share,
            light_height=budget.light_height,
            values=variant.materials.start,
            released="start-light" in variant.deviations,
            true_geometry="geometry" in variant.given,
            two_sided=RaySettings.of(variant).back_offset is not None,
            visibility=plan.visibility,
            indirect=plan.indirect,
            probed=variant.effects == "auto",
        )


def make_start(run: Run[Variant, Budget], initialised: Mapping[str, Any]) -> dict[str, Any]:
    """Surfels with initial materials, and the initial light, as plain tensors (see ``StartingModel``).

    ``initialised``: the product of stage 1. Also holds the state of the generator that was drawn from, and, for a probe
    of effects, the model of stage 1. Raises DataError if true geometry is given and not known.
    """
    settings, device = StartSettings.of(run.variant, run.budget), run.device
    views = load(chosen_views(run.scene, settings.view_share, run.seed), device)
    generator = torch.Generator(device).manual_seed(run.seed)
    learnt = surfels_of(initialised, device)
    chosen = given_geometry(learnt, ("geometry",) if settings.true_geometry else (), run.scene)
    values, rows = settings.values, settings.light_height
    if settings.released:
        light = constant_light(rows, START_RADIANCE, chosen.centre.device)
        model = StartingModel(chosen.with_material(values.albedo, values.roughness), light, searched=False)
    else:
        plan = EffectPlan(visibility=settings.visibility, indirect=settings.indirect)
        rays = SharedRays(chosen, settings.two_sided, plan)
        model = starting_model(rays, views, rows, values, generator, SUN_ROWS)
    made = {**model.tensors(), "searched": model.searched, "generator": generator.get_state()}
    if settings.probed:
        light = initialised["optimiser"]["tensors"]["log_environment"].to(device)
        made["initialised"] = LitSurfels(learnt, light).tensors()
    return made
