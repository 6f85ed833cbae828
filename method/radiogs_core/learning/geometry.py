"""Settings of ``FitGeometry``: every weight, learning rate and schedule by which surfels are learnt from posed images.

Schedules are shares of the stage's iterations, so that a short run follows the same schedule as a long one; the
released schedule of 2DGS and RadioGS has 40,000 iterations. Defaults are the paper's (RadioGS, training details) unless
a field names another source.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Literal

from ..errors import UsageError
from ..plain_values import NotNegative, require
from ..surfels.density import AdaptiveDensity
from ..surfels.starting_points import SurfelStart
from ..surfels.surroundings import SurroundingsStart
from .losses import ABSOLUTE_WEIGHT, SIMILARITY_WEIGHT

DEGREES = 3
"""Degrees of harmonics that are turned on one after another."""


@dataclass(frozen=True)
class GeometryWeights(NotNegative):
    """Weights of the losses; 0 turns a loss off."""

    absolute: float = ABSOLUTE_WEIGHT
    """Weight of L1 between each blended image and the training image, in display sRGB (3DGS)."""
    similarity: float = SIMILARITY_WEIGHT
    """Weight of 1 - SSIM between these images (3DGS)."""
    radiance: float = 1.0
    """Factor of both for the image of the surfels' own radiance; the released code leaves this image out of stage 1 in
    three scenes."""
    normal: float = 0.05
    """Weight of the distance between the surfels' normals and the depth map's normals (2DGS), until
    ``GeometrySchedule.normal_late_from``."""
    normal_late: float = 0.1
    """Weight of this distance afterwards. At 0.2 curved surfaces become flat: the normal error grows by 1.0 degrees on
    ``corner`` and by 0.4 on ``red_white``."""
    distortion: float = 0.1
    """Weight of the depth distortion in units of (z / camera distance)^2. The released 1000 on m(z) = (100 - 20 / z) /
    99.8 would be 2 here (dm = 0.2 / z^2 dz at the data sets' distance of 4.5); measured on ``corner`` at 700
    iterations, 30 breaks the geometry (normal error 52 degrees), and 0.1 to 0.3 reconstructs it better than 2."""
    mask: float = 0.05
    """Weight of the cross-entropy between coverage and the mask."""
    normal_smoothness: float = 0.05
    """Weight of the edge-aware smoothness of the normal map: its gradient, except at edges of the image."""


@dataclass(frozen=True)
class GeometrySchedule:
    """When losses and harmonics are turned on, and when learning rates change, as shares of the stage."""

    moving_from: float = 0.05
    """Share until which surfels that start on swept surfaces (``SurfelStart.points``) keep their positions, rotations
    and scales and only learn colour and opacity. The first steps are long and would spoil a nearly correct shape."""
    distortion_from: float = 3_000 / 40_000
    """Share from which the distortion loss is on."""
    degrees_from: tuple[float, ...] = (6_000 / 40_000, 7_000 / 40_000, 8_000 / 40_000)
    """Shares from which the harmonics of degree 1, 2 and 3 are learnt."""
    normal_late_from: float = 0.3
    """Share from which ``GeometryWeights.normal_late`` replaces ``GeometryWeights.normal``."""
    normal_smoothness_until: float = 1.0
    """Share until which the loss on neighbouring normals is on (released code: 18,000 of 40,000 steps)."""
    decay_from: float = 0.5
    """Share from which all learning rates except the positions' decay geometrically, to ``SurfelRates.end_share`` of
    their value. Short runs take long steps; at constant rates the surfels would keep oscillating about the optimum."""
    position_decay_until: float = 30_000 / 40_000
    """Share until which the rate of positions decays geometrically to ``SurfelRates.position_end``."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", *(each.name for each in fields(self)))
        if len(self.degrees_from) > DEGREES:
            raise UsageError(f"degrees_from: {self.degrees_from} has more than {DEGREES} shares")


@dataclass(frozen=True)
class SurfelRates(NotNegative):
    """Adam's learning rates of the surfels' parameters, as in 2DGS."""

    position: float = 1.6e-4
    """Rate of positions at the start, in scene extents (see ``Scene.extent``); multiplied by the budget's
    ``geometry.rate``."""
    position_end: float = 1.6e-6
    """Rate of positions from ``GeometrySchedule.position_decay_until`` on, in the same unit."""
    rotation: float = 0.001
    """Rate of quaternions; multiplied by the root of the budget's ``geometry.rate`` (``turning``)."""
    scale: float = 0.005
    """Rate of the logarithms of scales."""
    opacity: float = 0.05
    """Rate of the logits of opacity."""
    radiance: float = 0.0025
    """Rate of the harmonics of degree 0."""
    radiance_rest: float = 0.0025 / 20
    """Rate of the harmonics of higher degrees."""
    end_share: float = 0.05
    """Share of each rate above, except the positions' rates, that is left at the end."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self, "between 0 and 1", "end_share")


def turning(geometry_rate: float) -> float:
    """Factor of the learning rate of rotations: the root of the positions' factor ``geometry_rate``.

    A shorter run needs longer steps of the positions, which converge late where images constrain them weakly. Rotations
    converge early; their error is the noise of their steps, which grows with the root of the number of steps. After
    2,000 steps with seed 0, the normal errors of ``corner``, ``red_white`` and ``bowl`` are 6.6, 8.8 and 18.6 degrees
    with both factors 6; 6.2, 7.8 and 16.4 with 12 and its root; 7.8, 8.3 and 14.7 with 24 and its root.
    """
    return math.sqrt(geometry_rate)


@dataclass(frozen=True)
class GeometryLearning:
    """All settings of ``FitGeometry``."""

    weights: GeometryWeights = field(default_factory=GeometryWeights)
    """Weights of the losses."""
    schedule: GeometrySchedule = field(default_factory=GeometrySchedule)
    """When losses and harmonics are turned on, and when learning rates change."""
    rates: SurfelRates = field(default_factory=SurfelRates)
    """Learning rates."""
    density: AdaptiveDensity = field(default_factory=AdaptiveDensity)
    """When and where surfels are added and removed."""
    start: SurfelStart = field(default_factory=SurfelStart)
    """How surfels are initialised."""
    surroundings: SurroundingsStart = field(default_factory=SurroundingsStart)
    """How surfels are initialised in a scene without masks."""
    backgrounds: tuple[float, ...] = (1.0, 0.0)
    """Grey levels, display sRGB, on which images are composited in turn, one for each iteration. Both white and black
    are used, because on a single background a slightly transparent surface looks like a brighter one."""
    normal_target: Literal["one-sided", "central"] = "one-sided"
    """Differences by which normals of the depth map are computed (see ``Splat.depth_normal``)."""
    edge_sharpness: float = 10.0
    """How fast the smoothness loss falls at edges of the training image: its weight is exp(-sharpness |gradient|)."""
    across_silhouettes: bool = False
    """Whether the smoothness loss counts pixels at the object's silhouette."""
    encoding: Literal["straight", "premultiplied"] = "straight"
    """How a partly covered pixel is encoded for display (see ``kernels.image.display.displayed``)."""
    colour: Literal["linear", "display"] = "linear"
    """Colour space of the surfels' radiance: linear RGB, which light transport needs, or display sRGB, as in 2DGS."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "backgrounds")
        require(self, "zero or above", "edge_sharpness")
        if not self.backgrounds:
            raise UsageError("backgrounds: there is none", "Images are composited on a grey level.")
