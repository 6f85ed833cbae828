"""Registers SVG-IR with the harness: stages, presets and trained model."""

from radiogs_core.on_surfels.method import SurfelMethod

from .model import Model
from .settings import PRESETS, Variant
from .showing import TrainedSVGIR
from .training import InverseRendering

SVG_IR_METHOD = SurfelMethod(
    name="svg-ir",
    title="SVG-IR",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedSVGIR(Model.of(tensors), run),
)
