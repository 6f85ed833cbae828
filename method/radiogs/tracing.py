"""The tracer as a variant uses it."""

from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.tracer import SurfelTracer

from .profile import FIXED_OFFSET
from .variant import Variant


def tracer_of(surfels: Surfels, variant: Variant) -> SurfelTracer:
    """The tracer that a variant traces these surfels with."""
    return SurfelTracer(surfels, world_offset=FIXED_OFFSET if "fixed-offset" in variant.deviations else None)
