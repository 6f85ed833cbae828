"""RadioGS as the harness knows it: its stages, what each depends on, and its trained model."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from radiogs_core.capabilities import PARTS, MemoryPhase, Probe, ShortRun, TrainingImages, require_truth
from radiogs_core.contract import Run, Stage, StageSpec, Trained, values_but
from radiogs_core.scene.light import EnvironmentMap

from .budget import INVERSE_ONLY, PRESETS, RELIGHT_ONLY, Budget
from .model import Model
from .probing import probed
from .profile import PROFILES
from .rehearsing import memory_of, short_run, sizes
from .stages.initialise import Initialisation
from .stages.invert import InverseRendering
from .trained import TrainedRadioGS
from .variant import RELIGHTING, Variant


class RadioGS:
    """RadioGS (ICLR 2026): see ``radiogs_core.contract.Method``.

    ``profiles`` are named settings of the variant: the paper's formulas, or those of the released code. Every part of
    the truth can be given to it (``radiogs_core.capabilities.TakesGiven``).
    """

    name = "radiogs"
    title = "RadioGS"
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    given_parts = PARTS
    size_name = "surfels"
    relighting_modes = RELIGHTING
    sources = ("radiogs.trained",)
    profiles: Mapping[str, Mapping[str, Any]] = {name: {"deviations": each} for name, each in PROFILES.items()}

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        """Initialisation and inverse rendering."""
        return (
            StageSpec(
                name="initialise",
                title="stage 1, initialisation",
                steps=budget.initialise_iterations,
                owner=self.name,
                reads={
                    "variant": variant.of_initialisation(),
                    "budget": values_but(budget, "name", *INVERSE_ONLY),
                },
                sources=("radiogs.stages.initialise",),
                begin=_initialise,
                compiles=True,
            ),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name", *RELIGHT_ONLY)},
                sources=("radiogs.stages.invert",),
                begin=_invert,
                compiles=True,
                uses_surfaces=any(part != "light" for part in variant.given),
            ),
        )

    def with_given(self, variant: Variant, parts: tuple[str, ...]) -> Variant:
        """The variant whose stage 2 begins with these parts of the truth; stage 1 is the same for all."""
        return replace(variant, given=parts)

    def probe(self, run: Run, trained: Trained | None, light: EnvironmentMap | None) -> Probe:
        """Which effects training, or relighting by ``light``, needs; see ``radiogs_core.capabilities.Probing``."""
        return probed(run, trained.model if isinstance(trained, TrainedRadioGS) else None, light)

    def sizes(self, budget: Budget) -> tuple[int, int]:
        """Surfels at the start, and at most; see ``radiogs_core.capabilities.Rehearsing``."""
        return sizes(budget)

    def short_run(self, variant: Variant, budget: Budget, size: int) -> ShortRun:
        """Few steps of every kind with so many surfels."""
        return short_run(variant, budget, size)

    def memory(self, variant: Variant, budget: Budget, size: int, images: TrainingImages) -> tuple[MemoryPhase, ...]:
        """Bytes by phase with so many surfels; see ``radiogs_core.capabilities.PlansMemory``."""
        return memory_of(variant, budget, size, images)

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> TrainedRadioGS:
        """The model from the product of inverse rendering."""
        return TrainedRadioGS(Model.of(tensors), run)


def _initialise(run: Run, before: Mapping[str, Any]) -> Stage:
    require_truth(run.scene, run.variant.given)  # not only when stage 1 is done
    return Initialisation(run.scene, run.variant, run.budget, run.seed, run.device)


def _invert(run: Run, before: Mapping[str, Any]) -> Stage:
    return InverseRendering(run.scene, run.variant, run.budget, run.seed, run.device, before)


RADIOGS = RadioGS()
