"""``RADIOGS``, the method for the harness: its stages with their dependencies, and its trained model."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.capabilities import PARTS, Probe, require_truth
from radiogs_core.contract import STANDARD_MAPS, Prepared, Run, SharedStart, Stage, StageSpec, Trained, values_but
from radiogs_core.on_surfels.trained import Shown
from radiogs_core.scene.lamps import Lamp
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.lamp_light import extent_of
from radiogs_core.transport.plan import EffectPlan

from .constants import recipe_table
from .effects.probing import probe_run
from .effects.training import Planner
from .initialise import Initialisation
from .invert import InverseRendering
from .model import Model
from .recipes import PUBLISHED, RECIPES, recipe_values
from .rehearsing import short_run, sizes
from .relighting import relight
from .settings import INVERSE_ONLY, PRESETS, RELIGHTING, Budget, Variant
from .showing import TrainedRadioGS
from .start import StartSettings, make_start

RECOMMENDED = "recommended"
"""The recipe with the default values; it has no published length."""


class RadioGS:
    """RadioGS (ICLR 2026): see ``radiogs_core.contract.Method``.

    ``recipes`` are the paper's values, the published code's values, and the recommended values, which are the defaults
    (``radiogs_core.capabilities.OffersRecipes``). The method accepts every part of the truth
    (``radiogs_core.capabilities.TakesGiven``).
    """

    name = "radiogs"
    title = "RadioGS"
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    given_parts = PARTS
    size_name = "surfels"
    relighting_modes = RELIGHTING
    sizes = staticmethod(sizes)
    short_run = staticmethod(short_run)
    sources = ("radiogs.showing",)
    recipes: Mapping[str, str] = {name: each.title for name, each in RECIPES.items()}
    published_recipe = PUBLISHED

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec[Variant, Budget]]:
        """Initialisation and inverse rendering."""
        return (
            StageSpec(
                name="initialise",
                title="stage 1, initialisation",
                steps=budget.geometry.steps,
                owner=self.name,
                reads={
                    "variant": variant.of_initialisation(),
                    "budget": values_but(budget, "name", *INVERSE_ONLY),
                },
                sources=("radiogs.initialise",),
                begin=_initialise,
                compiles=True,
            ),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name", *budget.shown_only)},
                sources=("radiogs.invert", *(("radiogs.effects.training",) if variant.effects == "auto" else ())),
                begin=inverse_rendering,
                compiles=True,
                uses_surfaces=any(part != "light" for part in variant.given),
                start=SharedStart(
                    reads=asdict(StartSettings.of(variant, budget)),
                    sources=("radiogs.start",),
                    make=make_start,
                    begin=_from_start,
                    uses_surfaces="geometry" in variant.given,
                ),
            ),
        )

    def with_given(self, variant: Variant, parts: tuple[str, ...]) -> Variant:
        """The variant whose stage 2 begins with these parts of the truth; stage 1 does not depend on them.

        Raises UsageError for an unknown part, and for parts that contradict other fields of the variant.
        """
        return replace(variant, given=parts)

    def recipe_values(self, name: str, layout: str, scene: str) -> Mapping[str, Any]:
        """The values of a recipe for a scene; see ``radiogs_core.capabilities.OffersRecipes``."""
        return recipe_values(name, layout, scene)

    def recipe_at(self, name: str, variant: Variant, budget: Budget) -> str:
        """``printed, shortened (600 steps, rates x 12)``; see ``radiogs_bench.methods.ShortensRecipes``.

        The mark has the steps of stage 2 where they are fewer than published, and the factor of the rates of materials,
        light and harmonics. At the published length, another preset than ``paper`` is named: ``closed at tiny``.
        """
        preset, steps = budget.name.partition(",")[0], budget.inverse_iterations
        if name == RECOMMENDED:
            return name
        if steps < PRESETS["paper"].inverse_iterations:
            return f"{name}, shortened ({steps:,} steps, rates x {variant.materials.rates.factor(steps):.3g})"
        return name if preset == "paper" else f"{name}, closed at {preset}"

    def recipe_table(self) -> str:
        """All values of the recipes with their sources, as Markdown."""
        return recipe_table()

    def probe(self, run: Run[Variant, Budget], trained: Trained | None, light: EnvironmentMap | None) -> Probe:
        """The effects that training, or relighting by ``light``, needs; see ``radiogs_core.capabilities.Probing``."""
        return probe_run(run, trained.model if isinstance(trained, TrainedRadioGS) else None, light)

    def relit_by_lamps(
        self, trained: Trained, lamps: Sequence[Lamp], light: EnvironmentMap | None, albedo_scale: Float[Tensor, "3"]
    ) -> Prepared:
        """The model in mode "bounces" with all effects; see ``radiogs_core.transport.lamp_light.RelitByLamps``."""
        assert isinstance(trained, TrainedRadioGS)
        run, plan = trained.run, EffectPlan(light_sampling=light is not None)
        run = replace(run, variant=replace(run.variant, relighting="bounces"))
        light = EnvironmentMap(torch.zeros(2, 4, 3)) if light is None else light
        lit = relight(trained.model, light, albedo_scale, run, plan=plan, lamps=lamps)
        return Shown(lit, STANDARD_MAPS, (extent_of(lit.surfels),))

    def restore(self, run: Run[Variant, Budget], tensors: Mapping[str, Any]) -> TrainedRadioGS:
        """The model from the product of inverse rendering. Raises DataError for malformed tensors."""
        return TrainedRadioGS(Model.of(tensors), run)


def _initialise(run: Run[Variant, Budget], before: Mapping[str, Any]) -> Stage:
    require_truth(run.scene, run.variant.given)  # before stage 1, although only stage 2 needs it
    return Initialisation(run)


def inverse_rendering(run: Run[Variant, Budget], initialised: Mapping[str, Any]) -> InverseRendering:
    """Stage 2 of a run, from the product of stage 1."""
    return _from_start(run, make_start(run, initialised))


def _from_start(run: Run[Variant, Budget], made: Mapping[str, Any]) -> InverseRendering:
    return InverseRendering(run, made, Planner(run, made) if run.variant.effects == "auto" else None)


RADIOGS = RadioGS()
