"""IRGS as the harness knows it: its stages, what each depends on, and its trained model."""

from ..surfel_method import SurfelMethod
from .budget import PRESETS, SHOWN_ONLY
from .model import Model
from .stage import InverseRendering
from .trained import TrainedIRGS
from .variant import Variant

IRGS_METHOD = SurfelMethod(
    name="irgs",
    title="IRGS",
    package=__package__,
    variant=Variant,
    presets=PRESETS,
    begin=InverseRendering,
    trained=lambda tensors, run: TrainedIRGS(Model.of(tensors), run),
    shown_only=SHOWN_ONLY,
)
