"""Rays as a variant traces them: where they start, and in which directions."""

from dataclasses import dataclass

from radiogs_core.surfels.known_surfaces import KnownRadiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.tracer import BACK_OFFSET, SurfelTracer

from .known_indirect import KnownIndirectTracer
from .profile import FIXED_OFFSET
from .variant import Variant


@dataclass(frozen=True)
class Rays:
    """world_offset: how far from their own surfel rays start, world units; None: in its own standard deviations.
    floor: whether directions end 10 degrees above the horizon (see ``hemisphere_directions``). back_offset: see
    ``SurfelTracer``. indirect: where L_ind comes from if it is given (``given``); None: from the surfels themselves."""

    world_offset: float | None = None
    floor: bool = False
    back_offset: float | None = BACK_OFFSET
    indirect: KnownRadiance | None = None

    @classmethod
    def of(cls, variant: Variant, indirect: KnownRadiance | None = None) -> "Rays":
        """Those of a variant: the paper's, unless it reproduces the released code."""
        released = variant.deviations
        return cls(
            FIXED_OFFSET if "fixed-offset" in released else None,
            "hemisphere-floor" in released,
            None if "one-sided-rays" in released else BACK_OFFSET,
            indirect,
        )

    def tracer(self, surfels: Surfels) -> SurfelTracer:
        """A tracer of these surfels."""
        if self.indirect is not None:
            return KnownIndirectTracer(surfels, self.indirect.surfels, self.world_offset, self.back_offset)
        return SurfelTracer(surfels, world_offset=self.world_offset, back_offset=self.back_offset)
