"""IRGS as the harness knows it: its stages, what each depends on, and its trained model."""

from ..surfel_method import SurfelMethod
from .model import Model
from .settings import BUDGET_SHOWN_ONLY, PRESETS, Variant
from .showing import TrainedIRGS
from .training import InverseRendering

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
