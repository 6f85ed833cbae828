"""Registers IRGS with the harness: stages, presets and trained model."""

from radiogs_core.on_surfels.method import SurfelMethod
from radiogs_core.on_surfels.model import LitSurfels

from .settings import PRESETS, Variant
from .showing import TrainedIRGS
from .training import InverseRendering

IRGS_METHOD = SurfelMethod(
    name="irgs",
    title="IRGS",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedIRGS(LitSurfels.of(tensors), run),
)
