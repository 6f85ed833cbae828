"""Rays as a variant traces them: where they start, and in which directions."""

from dataclasses import dataclass

from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.tracer import SurfelTracer

from .profile import FIXED_OFFSET
from .variant import Variant


@dataclass(frozen=True)
class Rays:
    """world_offset: how far from their own surfel rays start, world units; None: in its own standard deviations.
    floor: whether directions end 10 degrees above the horizon (see ``hemisphere_directions``)."""

    world_offset: float | None = None
    floor: bool = False

    @classmethod
    def of(cls, variant: Variant) -> "Rays":
        """Those of a variant: the paper's, unless it reproduces the released code."""
        return cls(
            FIXED_OFFSET if "fixed-offset" in variant.deviations else None, "hemisphere-floor" in variant.deviations
        )

    def tracer(self, surfels: Surfels) -> SurfelTracer:
        """A tracer of these surfels."""
        return SurfelTracer(surfels, world_offset=self.world_offset)
