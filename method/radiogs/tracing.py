"""Rays as a variant traces them: where they start, and in which directions."""

from dataclasses import dataclass

from radiogs_core.learning.known_radiance import KnownRadiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.tracer import SurfelTracer

from .known_indirect import KnownIndirectTracer
from .profile import FIXED_OFFSET
from .variant import Variant


@dataclass(frozen=True)
class Rays:
    """world_offset: how far from their own surfel rays start, world units; None: in its own standard deviations.
    floor: whether directions end 10 degrees above the horizon (see ``hemisphere_directions``). indirect: where L_ind
    comes from if it is given (``given``); None: from the surfels themselves."""

    world_offset: float | None = None
    floor: bool = False
    indirect: KnownRadiance | None = None

    @classmethod
    def of(cls, variant: Variant, indirect: KnownRadiance | None = None) -> "Rays":
        """Those of a variant: the paper's, unless it reproduces the released code."""
        offset = FIXED_OFFSET if "fixed-offset" in variant.deviations else None
        return cls(offset, "hemisphere-floor" in variant.deviations, indirect)

    def tracer(self, surfels: Surfels) -> SurfelTracer:
        """A tracer of these surfels."""
        if self.indirect is not None:
            return KnownIndirectTracer(surfels, self.indirect.surfels, self.world_offset)
        return SurfelTracer(surfels, world_offset=self.world_offset)
