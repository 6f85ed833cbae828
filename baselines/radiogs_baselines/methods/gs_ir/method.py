"""GS-IR as the harness knows it: its stages, what each depends on, and its trained model."""

from collections.abc import Mapping, Sequence
from typing import Any

from radiogs_core.contract import Run, StageSpec, values_but
from radiogs_core.learning.fit_geometry import fit_geometry

from .budget import PRESETS, Budget
from .model import Model
from .stage import InverseRendering
from .trained import TrainedGSIR
from .variant import Variant


class GSIR:
    """GS-IR on the primitives of ``radiogs_core``: see ``radiogs_core.contract.Method`` and docs/baselines.md."""

    name = "gs-ir"
    title = "GS-IR"
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    sources = ("radiogs_baselines.methods.gs_ir.trained",)

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        """The shared stage of geometry, and inverse rendering."""
        return (
            fit_geometry(variant.geometry, budget, variant.view_share),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name")},
                sources=("radiogs_baselines.methods.gs_ir.stage",),
                begin=InverseRendering,
                compiles=True,
            ),
        )

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> TrainedGSIR:
        """The model from the product of inverse rendering."""
        return TrainedGSIR(Model.of(tensors), run)


GS_IR_METHOD = GSIR()
