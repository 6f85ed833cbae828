"""Solid textures: patterns as functions of the world position, each between zero and one.

Every pattern is written once, in arithmetic that ``torch``, ``numpy`` and ``drjit`` share, so that what is rendered and
what is given as ground truth are the same formula. It needs no coordinates on the surface. Printed text has
capital letters of straight strokes.
"""

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

Point = tuple[float, float, float]

Array = Any
"""Values of one coordinate at many points: a torch or numpy array, or a Dr.Jit ``Float``."""

Arithmetic = ModuleType
"""The library that owns the arrays: ``torch``, ``numpy`` or ``drjit``; patterns use their common functions only."""


@dataclass(frozen=True)
class Checker:
    """Cubes of one side length, alternately 0 and 1; one with 0 has its lowest corner at ``origin``.

    No face of a solid may lie in a plane between cubes: rounding would decide.
    """

    side: float
    origin: Point

    def share(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> Array:
        """0 or 1 at world positions."""
        cell = sum(
            maths.floor((value - start) / self.side) for value, start in zip((x, y, z), self.origin, strict=True)
        )
        return cell - 2 * maths.floor(cell / 2)


@dataclass(frozen=True)
class Stripes:
    """Slabs across ``direction`` (unit length): a part ``duty`` of each ``period`` (world units) is 1, the rest 0."""

    direction: Point
    period: float
    duty: float

    def share(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> Array:
        """0 or 1 at world positions."""
        u, v, w = self.direction
        return _periodic((u * x + v * y + w * z) / self.period, self.duty, maths)


@dataclass(frozen=True)
class Rings:
    """Spherical shells around ``centre``, which planes cut in concentric rings; ``period`` and ``duty`` as stripes."""

    centre: Point
    period: float
    duty: float

    def share(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> Array:
        """0 or 1 at world positions."""
        u, v, w = (value - start for value, start in zip((x, y, z), self.centre, strict=True))
        return _periodic(maths.sqrt(u * u + v * v + w * w) / self.period, self.duty, maths)


@dataclass(frozen=True)
class Noise:
    """A sum of plane waves with random directions and phases, of ``longest`` down to ``shortest`` wavelength.

    It has unit variance before it is scaled by ``contrast`` and clipped around 1/2; a large contrast gives flat
    patches.
    """

    longest: float
    shortest: float
    contrast: float
    seed: int

    def share(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> Array:
        """From 0 to 1 at world positions."""
        total = 0.0
        for amplitude, (u, v, w), phase in waves(self.longest, self.shortest, self.seed):
            total = total + amplitude * maths.sin(u * x + v * y + w * z + phase)
        return maths.clip(0.5 + self.contrast * total, 0.0, 1.0)


@dataclass(frozen=True)
class Print:
    """A line of capital letters, 1 where there is ink, in the plane through ``origin`` along two unit directions.

    ``origin`` is the lower left end of the first letter, ``height`` the height of letters and ``thickness`` of their
    strokes, in world units. The ink goes all the way through a solid, so that its back bears mirrored letters.
    """

    text: str
    origin: Point
    along: Point
    upwards: Point
    height: float
    thickness: float

    def share(self, x: Array, y: Array, z: Array, maths: Arithmetic) -> Array:
        """0 or 1 at world positions."""
        offset = tuple(value - start for value, start in zip((x, y, z), self.origin, strict=True))
        u, v = (
            sum(step * part for step, part in zip(direction, offset, strict=True)) / self.height
            for direction in (self.along, self.upwards)
        )
        nearest: Array = u * 0 + math.inf
        for (u0, v0), (u1, v1) in segments(self.text):
            du, dv = u1 - u0, v1 - v0
            place = maths.clip(((u - u0) * du + (v - v0) * dv) / (du * du + dv * dv), 0.0, 1.0)
            off_u, off_v = u - u0 - place * du, v - v0 - place * dv
            nearest = maths.minimum(nearest, off_u * off_u + off_v * off_v)
        half = 0.5 * self.thickness / self.height
        return 1 - maths.clip(maths.floor(nearest / half**2), 0.0, 1.0)


Pattern = Checker | Stripes | Rings | Noise | Print


def _periodic(phase: Array, duty: float, maths: Arithmetic) -> Array:
    """1 in the last part ``duty`` of each period of length one, else 0."""
    return maths.floor(phase - maths.floor(phase) + duty)


WAVES = 24


@lru_cache
def waves(longest: float, shortest: float, seed: int) -> tuple[tuple[float, Point, float], ...]:
    """Amplitude, wave vector (radian per unit) and phase of sines in random directions, with unit variance in sum."""
    random = np.random.default_rng(seed).random((WAVES, 3))
    length = longest * (shortest / longest) ** (np.arange(WAVES) / (WAVES - 1))
    amplitude = np.sqrt(2 * length / length.sum())
    height, azimuth = 2 * random[:, 0] - 1, 2 * math.pi * random[:, 1]
    flat = np.sqrt(1 - height**2)
    vector = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height], -1) * (2 * math.pi / length)[:, None]
    return tuple(
        (float(a), (float(u), float(v), float(w)), float(2 * math.pi * phase))
        for a, (u, v, w), phase in zip(amplitude, vector, random[:, 2], strict=True)
    )


Segment = tuple[tuple[float, float], tuple[float, float]]
"""From one end to the other, each to the right and upwards from the lower left of a text, in heights of a letter."""

GLYPH_WIDTH = 0.6
GLYPH_SPACING = 0.35
"""Width of a letter, and distance between the strokes of neighbouring letters, in heights of a letter."""

GLYPHS = {
    "A": "00 14 20, 0B 2B",
    "D": "00 04 14 23 21 10 00",
    "F": "00 04 24, 02 12",
    "G": "23 14 03 01 10 21 22 12",
    "I": "10 14",
    "L": "04 00 20",
    "O": "10 01 03 14 23 21 10",
    "R": "00 04 14 23 12 02, 12 20",
    "S": "01 10 21 03 14 23",
    "U": "04 01 10 21 24",
}
"""Polylines on a grid three points wide and five high, as column and row from the lower left; B is a row and a half."""

GLYPH_ROWS = {"0": 0.0, "1": 0.25, "B": 0.375, "2": 0.5, "3": 0.75, "4": 1.0}


def segments(text: str) -> tuple[Segment, ...]:
    """The strokes of a text on one line. Raises ValueError for a letter that has none."""
    unknown = sorted(set(text) - set(GLYPHS) - {" "})
    if unknown:
        raise ValueError(f"no strokes for {', '.join(unknown)} in the text '{text}'; there are {''.join(GLYPHS)}")
    strokes: list[Segment] = []
    for place, letter in enumerate(text):
        left = place * (GLYPH_WIDTH + GLYPH_SPACING)
        for polyline in GLYPHS[letter].split(", ") if letter != " " else ():
            points = [(left + int(point[0]) * GLYPH_WIDTH / 2, GLYPH_ROWS[point[1]]) for point in polyline.split()]
            strokes += itertools.pairwise(points)
    return tuple(strokes)
