"""The solids that scenes are made of, as data."""

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
    middle, and ``swing`` how far the tube's middle is from that circle. The tube must not meet itself: ``swing`` must
    exceed ``radius``, and so must 0.85 (``ring`` - ``swing``), as three strands pass the axis that near.
    """

    centre: Point
    ring: float
    swing: float
    radius: float
    material: Finish


Solid = Box | Sphere | Knot
