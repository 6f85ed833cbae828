"""Registers GS-IR with the harness: stages, presets and trained model."""

from radiogs_core.on_surfels.method import SurfelMethod

from .model import Model
from .settings import PRESETS, Variant
from .showing import TrainedGSIR
from .training import InverseRendering

GS_IR_METHOD = SurfelMethod(
    name="gs-ir",
    title="GS-IR",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedGSIR(Model.of(tensors), run),
)
