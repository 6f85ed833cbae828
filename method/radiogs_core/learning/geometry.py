"""How surfels are learnt from posed images: every weight, rate and share of ``FitGeometry`` as data.

Shares are of the stage's iterations, so that a short run goes through the same schedule as a long one; the released
schedule of 2DGS and RadioGS is of 40,000 iterations. Defaults are the paper's (RadioGS, training details) where nothing
else is said.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

from ..surfels.density import AdaptiveDensity
from ..surfels.starting_points import SurfelStart
from ..surfels.surroundings import SurroundingsStart
from .losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT


@dataclass(frozen=True)
class GeometryWeights:
    """Weights of the losses; 0 leaves one out."""

    absolute: float = ABSOLUTE_WEIGHT
    """L1 between each blended image and the training image, in display sRGB (3DGS)."""
    similarity: float = SIMILARITY_WEIGHT
    """1 - SSIM between these images (3DGS)."""
    normal: float = 0.05
    """Distance between the surfels' normals and those of the depth map (2DGS)."""
    normal_late: float = 0.1
    """The same from ``GeometrySchedule.normal_late_from`` on. At 0.2 round things are flattened: normals of ``corner``
    are 1.0 degrees worse, those of ``red_white`` 0.4."""
    distortion: float = 0.1
    """Depth distortion in units of (z / camera distance)^2. The released 1000 on m(z) = (100 - 20 / z) / 99.8
    would be 2 here (dm = 0.2 / z^2 dz at the data sets' distance of 4.5); measured on ``corner`` at 700 iterations, 30
    breaks the geometry (normal error 52 degrees), and 0.1 to 0.3 reconstructs it better than 2."""
    mask: float = 0.05
    """Cross-entropy between coverage and the mask."""
    normal_smoothness: float = 0.05
    """Slopes of the normals where the image has no edges."""


@dataclass(frozen=True)
class GeometrySchedule:
    """When losses and harmonics set in, and when rates change, as shares of the stage."""

    moving_from: float = 0.05
    """Share before which surfels that start on swept surfaces (``SurfelStart.points``) stay there, as wide and turned
    as they are, while they take their colours: the first steps are long, and spoil a shape that is nearly right."""
    distortion_from: float = 3_000 / 40_000
    """Share after which the distortion counts."""
    degrees_from: tuple[float, ...] = (6_000 / 40_000, 7_000 / 40_000, 8_000 / 40_000)
    """Shares after which harmonics of degree 1, 2 and 3 are learnt too."""
    normal_late_from: float = 0.3
    """Share after which normals and depth are held together by ``GeometryWeights.normal_late``."""
    decay_from: float = 0.5
    """Share from which the rates of all but positions fall, geometrically, to ``SurfelRates.end_share`` of theirs.
    Short runs take long steps; constant ones leave the surfels trembling about what they have found."""
    position_decay_until: float = 30_000 / 40_000
    """Share at which the rate of positions has fallen to ``SurfelRates.position_end``."""


@dataclass(frozen=True)
class SurfelRates:
    """Adam's learning rates of surfels; positions in scene extents (see ``Scene.extent``). Those of 2DGS."""

    position: float = 1.6e-4
    """Rate of centres at the start; times ``geometry_rate`` of the budget."""
    position_end: float = 1.6e-6
    """Rate of centres after ``GeometrySchedule.position_decay_until``; geometric in between."""
    rotation: float = 0.001
    """Rate of quaternions; times the root of ``geometry_rate`` of the budget (``turning``)."""
    scale: float = 0.005
    """Rate of log-scales."""
    opacity: float = 0.05
    """Rate of the opacity's logits."""
    radiance: float = 0.0025
    """Rate of the harmonics of degree 0."""
    radiance_rest: float = 0.0025 / 20
    """Rate of the harmonics of higher degrees."""
    end_share: float = 0.05
    """Share of the rates above (but for positions) that is left at the end."""


def turning(geometry_rate: float) -> float:
    """Factor of the rate of rotations where that of positions is ``geometry_rate``.

    A shorter run takes longer steps to come as far: where images say little, positions arrive late. Rotations are near
    their aim early, and what limits them is the noise of their steps, which adds up by the root of their number. In
    2,000 steps, seed 0, normals of ``corner``, ``red_white`` and ``bowl`` are 6.6, 8.8 and 18.6 degrees off where both
    factors are 6; 6.2, 7.8 and 16.4 at 12 and its root; 7.8, 8.3 and 14.7 at 24 and its root.
    """
    return math.sqrt(geometry_rate)


@dataclass(frozen=True)
class GeometryLearning:
    """What ``FitGeometry`` learns surfels by."""

    weights: GeometryWeights = field(default_factory=GeometryWeights)
    """Weights of the losses."""
    schedule: GeometrySchedule = field(default_factory=GeometrySchedule)
    """When losses and harmonics set in."""
    rates: SurfelRates = field(default_factory=SurfelRates)
    """Learning rates."""
    density: AdaptiveDensity = field(default_factory=AdaptiveDensity)
    """When and where surfels are added and removed."""
    start: SurfelStart = field(default_factory=SurfelStart)
    """What surfels start as."""
    surroundings: SurroundingsStart = field(default_factory=SurroundingsStart)
    """Where they start in a scene without masks."""
    backgrounds: tuple[float, ...] = (1.0, 0.0)
    """Grey levels, display sRGB, that images are composited on in turn, one an iteration. White and black: on one
    alone, a surface that is a little transparent can pass for a brighter one."""
    normal_target: Literal["one-sided", "central"] = "one-sided"
    """Differences that make normals of the depth map (see ``transport.depth_normals``)."""
    edge_sharpness: float = 10.0
    """How fast smoothness lets go where the training image has an edge: exp(-sharpness |gradient|)."""
    across_silhouettes: bool = False
    """Whether smoothness is asked of pixels at the object's silhouette."""
    encoding: Literal["straight", "premultiplied"] = "straight"
    """What of a partly covered pixel is encoded for display (see ``splatting.displayed``)."""
    colour: Literal["linear", "display"] = "linear"
    """What the surfels' radiance is: linear, so that light can be traced through it, or display sRGB, as in 2DGS."""
