"""Registers GI-GS with the harness: stages, presets and trained model."""

from radiogs_core.on_surfels.method import SurfelMethod

from ..gs_ir.metallic import MetallicSurfels
from .settings import PRESETS, Variant
from .showing import TrainedGIGS
from .training import InverseRendering

GI_GS_METHOD = SurfelMethod(
    name="gi-gs",
    title="GI-GS",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedGIGS(MetallicSurfels.of(tensors), run),
)
