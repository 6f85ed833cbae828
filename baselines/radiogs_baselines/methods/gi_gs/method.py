"""GI-GS as the harness knows it: its stages, what each depends on, and its trained model."""

from collections.abc import Mapping, Sequence
from typing import Any

from radiogs_core.contract import Run, StageSpec, values_but
from radiogs_core.learning.fit_geometry import fit_geometry

from .budget import PRESETS, SHOWN_ONLY, Budget
from .model import Model
from .stage import InverseRendering
from .trained import TrainedGIGS
from .variant import Variant


class GIGS:
    """GI-GS on the primitives of ``radiogs_core``: see ``radiogs_core.contract.Method`` and docs/baselines.md."""

    name = "gi-gs"
    title = "GI-GS"
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    sources = ("radiogs_baselines.methods.gi_gs.trained",)

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        """The shared stage of geometry, and inverse rendering."""
        return (
            fit_geometry(variant.geometry, budget, variant.view_share),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name", *SHOWN_ONLY)},
                sources=("radiogs_baselines.methods.gi_gs.stage",),
                begin=InverseRendering,
                compiles=True,
            ),
        )

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> TrainedGIGS:
        """The model from the product of inverse rendering."""
        return TrainedGIGS(Model.of(tensors), run)


GI_GS_METHOD = GIGS()
