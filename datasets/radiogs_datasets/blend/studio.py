"""Renders pictures of the open file with one of Blender's processes, and writes lights for Blender."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..layouts.tensoir import TRAINING_LIGHT
from ..writing import opengl
from .cameras import Shot
from .passes import Maps, maps_of, read_passes
from .process import Blender
from .request import Request

SEEDS = 2**31 - 1
"""Cycles' seeds are non-negative 32-bit integers."""

OTHER_SEED = 1_000_003
"""Added to a picture's number for a second picture with other noise: their difference measures the noise."""


@dataclass(frozen=True)
class Studio:
    """A process with the file open, the lights by role as files, and the file that receives each picture.

    passes: a folder for all passes of test views; None if they are not kept.
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
            camera=opengl(shot.camera),
            field_of_view=shot.field_of_view,
            size=request.size,
            samples=(shot.split == "test" and request.test_samples) or request.samples,
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


ROWS = 480
"""Rows that a map is refined to: beyond a pole, Blender continues a map with half a row of the other pole."""


def refined(light: NDArray[np.float32]) -> NDArray[np.float32]:
    """The map at an odd multiple of its size, at least ROWS rows, with the same bilinear lookup as the map itself.

    With an odd factor the texels' centres stay centres, so that both lookups have the same kinks. Columns wrap; rows
    end at the poles.
    """
    factor = max(1, -(-ROWS // light.shape[0]))
    factor += 1 - factor % 2
    return _along(_along(light, 0, factor, wrap=False), 1, factor, wrap=True)


def _along(light: NDArray[np.float32], axis: int, factor: int, wrap: bool) -> NDArray[np.float32]:
    count = light.shape[axis]
    place = (np.arange(count * factor) + 0.5) / factor - 0.5
    if not wrap:
        place = np.clip(place, 0, count - 1)
    below = np.floor(place).astype(int)
    shape = [1] * light.ndim
    shape[axis] = -1
    share = (place - below).reshape(shape)
    first, second = below % count, ((below + 1) % count if wrap else np.minimum(below + 1, count - 1))
    values = light.astype(np.float64)
    return ((1 - share) * values.take(first, axis) + share * values.take(second, axis)).astype(np.float32)
