"""Registers R3DG with the harness: stages, presets and trained model."""

from radiogs_core.on_surfels.method import SurfelMethod

from .model import Model
from .settings import PRESETS, Variant
from .showing import TrainedR3DG
from .training import InverseRendering

R3DG_METHOD = SurfelMethod(
    name="r3dg",
    title="R3DG",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedR3DG(Model.of(tensors), run),
)
