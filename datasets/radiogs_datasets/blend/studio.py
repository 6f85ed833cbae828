"""Taking pictures of the open file with one of Blender's processes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..layouts.tensoir_lights import TRAINING_LIGHT
from .cameras import Shot
from .passes import Maps, maps_of, read_passes
from .process import Blender
from .request import Request

SEEDS = 2**31 - 1
"""Cycles' seeds are non-negative 32-bit integers."""

OTHER_SEED = 1_000_003
"""Added to the number of a picture for the second of two whose difference is noise."""


@dataclass(frozen=True)
class Studio:
    """A process with the file open, the lights by role as files, and where a picture is put before it is read.

    passes: a folder for the pictures of test views, whole; None where they are not kept.
    """

    blender: Blender
    request: Request
    lights: Mapping[str, Path]
    scratch: Path
    passes: Path | None = None

    def take(
        self,
        shot: Shot,
        light: str = TRAINING_LIGHT,
        bounces: int | None = None,
        other_seed: bool = False,
        keep: Path | None = None,
    ) -> Maps:
        """The maps of a view under a light. Pictures of one view share their random numbers unless ``other_seed``.

        The file with all passes is moved to ``keep``, or removed.
        """
        request = self.request
        number = shot.number + other_seed * OTHER_SEED
        self.blender.ask(
            "render",
            light=str(self.lights[light]),
            camera=shot.opengl(),
            field_of_view=shot.field_of_view,
            size=request.size,
            samples=request.samples,
            bounces=request.bounces if bounces is None else bounces,
            seed=(request.seed * 1_000_000_007 + number) % SEEDS,
            distance=shot.distance,
            out=str(self.scratch.absolute()),
        )
        found = maps_of(read_passes(self.scratch))
        if keep is None:
            self.scratch.unlink()
        else:
            self.scratch.replace(keep)
        return found
