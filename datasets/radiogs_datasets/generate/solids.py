"""The solids that scenes are made of, as data."""

import math
from dataclasses import dataclass

from .materials import Finish
from .patterns import Point

GAP = 0.002
"""Between neighbours: faces are never coplanar, and no ray starts inside a solid."""


@dataclass(frozen=True)
class Box:
    """An axis-aligned box between two corners."""

    low: Point
    high: Point
    material: Finish


@dataclass(frozen=True)
class Sphere:
    """A sphere."""

    centre: Point
    radius: float
    material: Finish


@dataclass(frozen=True)
class Knot:
    """A closed tube of ``radius`` along a trefoil knot; see ``trefoil`` for its curve.

    The knot winds around a torus with a vertical axis through ``centre``: ``ring`` is the radius of the circle in its
    middle, and ``swing`` how far the tube's middle is from that circle. The tube must not intersect itself: ``swing``
    and 0.85 (``ring`` - ``swing``), the distance at which three strands pass the axis, must exceed ``radius``.
    """

    centre: Point
    ring: float
    swing: float
    radius: float
    material: Finish


@dataclass(frozen=True)
class Turned:
    """A solid of revolution around a vertical axis through ``centre``: a vessel, a pillar, a parasol.

    ``profile``: (distance from the axis, height above ``centre``) of the control points of a uniform cubic B-spline, in
    world units; it starts and ends on the axis, which it meets at a right angle, and the solid lies to its left. A
    vessel's goes up its outside and down its inside. Curves stay within the hull of four neighbouring points; a point
    given twice makes a sharper bend.
    """

    centre: Point
    profile: tuple[tuple[float, float], ...]
    material: Finish


@dataclass(frozen=True)
class Swell:
    """``height * exp(sharpness (cos angle - 1))`` about a direction in degrees, azimuth from +X to +Y.

    ``height`` is a part of the radius; a dent has less than zero.
    """

    azimuth: float
    elevation: float
    sharpness: float
    height: float

    @property
    def axis(self) -> Point:
        """The direction as a unit vector."""
        phi, theta = math.radians(self.azimuth), math.radians(self.elevation)
        return math.cos(theta) * math.cos(phi), math.cos(theta) * math.sin(phi), math.sin(theta)


@dataclass(frozen=True)
class Relief:
    """A body that every ray from ``centre`` leaves once, ``radius`` (1 + swells + ripples) away from it.

    The ripples are a sum of plane waves of the direction, from ``longest`` down to ``shortest`` wavelength in radian;
    their standard deviation is ``ripple``, a part of the radius.
    """

    centre: Point
    radius: float
    swells: tuple[Swell, ...]
    ripple: float
    longest: float
    shortest: float
    seed: int
    material: Finish


Solid = Box | Sphere | Knot | Turned | Relief
