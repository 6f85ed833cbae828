"""Registers TensoIR with the harness: stages, presets and trained model."""

from collections.abc import Mapping, Sequence
from typing import Any

from radiogs_core.contract import Run, StageSpec, values_but

from .model import Model
from .settings import BUDGET_INVERSE_ONLY, BUDGET_SHOWN_ONLY, PRESETS, Budget, Variant
from .showing import TrainedTensoIR
from .training import InverseRendering, RadianceField


class TensoIR:
    """TensoIR in plain PyTorch: see ``radiogs_core.contract.Method`` and docs/baselines.md."""

    name = "tensoir"
    title = "TensoIR"
    variant = Variant
    presets: Mapping[str, Budget] = PRESETS
    sources = ("radiogs_baselines.methods.tensoir.showing",)

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        """Stage 1, the radiance field, and stage 2, inverse rendering."""
        modules = ("radiogs_baselines.methods.tensoir.training",)
        return (
            StageSpec(
                name="field",
                title="stage 1, radiance field",
                steps=budget.field_iterations,
                owner=self.name,
                reads={"variant": variant.of_field(), "budget": values_but(budget, "name", *BUDGET_INVERSE_ONLY)},
                sources=modules,
                begin=RadianceField,
            ),
            StageSpec(
                name="invert",
                title="stage 2, inverse rendering",
                steps=budget.inverse_iterations,
                owner=self.name,
                reads={"variant": variant.of_training(), "budget": values_but(budget, "name", *BUDGET_SHOWN_ONLY)},
                sources=modules,
                begin=InverseRendering,
            ),
        )

    def restore(self, run: Run, tensors: Mapping[str, Any]) -> TrainedTensoIR:
        """The trained model from the product of stage 2."""
        return TrainedTensoIR(Model.of(tensors, run.device), run)


TENSOIR_METHOD = TensoIR()
