"""IRGS as the harness knows it: its stages, what each depends on, and its trained model."""

from ..surfel_method import SurfelMethod
from .model import Model
from .stage import InverseRendering
from .trained import TrainedIRGS
from .variant import PRESETS, BUDGET_SHOWN_ONLY, Variant

IRGS_METHOD = SurfelMethod(
    name="irgs",
    title="IRGS",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedIRGS(Model.of(tensors), run),
    shown_only=BUDGET_SHOWN_ONLY,
)
