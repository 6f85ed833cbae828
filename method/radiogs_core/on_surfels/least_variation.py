"""The light under which log-albedo differs least between points (see ``light_start``)."""

import math
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor

from ..kernels.adam import Adam
from ..learning.losses import unevenness
from ..scene.colour import LINEAR_KNEE
from ..scene.light import texel_solid_angles
from .lit_points import Light, SeenPoints, Transport
from .start_values import LightStart

ROUNDING = 1e-4
"""Constant under the root of the l1 distance of log-albedo: below its root the distance is quadratic."""

ADAM_EPSILON = 1e-8

SMALLEST_SHARE = 1e-4
"""Share of the mean irradiance that is added to it inside the logarithm."""


class Pairs(NamedTuple):
    """Pairs of points with weights: of each point with as many others."""

    second: Int[Tensor, "points others"]
    """Indices of the points with which each point is compared."""
    weight: Float[Tensor, " pairs"]
    """Weights of the pairs, point by point; they sum to 1."""

    def others(self, log_albedo: Float[Tensor, "points columns"]) -> Float[Tensor, "points others columns"]:
        """Log-albedo of the second points.

        By ``index_select``, whose gradient takes a fraction of the time of indexing in brackets.
        """
        return log_albedo.index_select(0, self.second.flatten()).view(*self.second.shape, log_albedo.shape[1])

    def differences(self, log_albedo: Float[Tensor, "points columns"]) -> Float[Tensor, "pairs columns"]:
        """Absolute differences of log-albedo, smoothed at zero."""
        return ((log_albedo[:, None] - self.others(log_albedo)).square() + ROUNDING).sqrt().flatten(0, 1)


class Variation:
    """How much log-albedo differs between near and distant points.

    Pairs weigh by the similarity of their chromaticities, because points of different chromaticity probably have
    different paints.
    """

    def __init__(self, points: SeenPoints, learning: LightStart) -> None:
        self.learning = learning
        self.radiance = points.radiance.clamp(min=LINEAR_KNEE)
        self.near = self._weighted(_near(points, learning.neighbours))
        self.far = self._weighted(_far(points, learning.far))

    def _weighted(self, second: Int[Tensor, "points others"]) -> Pairs:
        logarithm = self.radiance.log()
        chroma = logarithm - logarithm.mean(-1, keepdim=True)
        apart = (chroma[:, None] - chroma[second]).square().sum(-1).flatten()
        weight = torch.exp(-apart / (2 * self.learning.same_paint**2))
        return Pairs(second, weight / weight.sum().clamp(min=torch.finfo(weight.dtype).tiny))

    def of(self, log_albedo: Float[Tensor, "points columns"]) -> Float[Tensor, " columns"]:
        """The variation of each column: of each channel of the albedo, or of each of several albedos."""
        learning = self.learning
        apart = learning.other_paint * torch.tanh(self.far.differences(log_albedo) / learning.other_paint)
        near, far = self.near.differences(log_albedo).T @ self.near.weight, apart.T @ self.far.weight
        return (1 - learning.far_share) * near + learning.far_share * far

    def log_albedo(self, white: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Logarithm of the albedo where white surfaces have the radiance ``white``."""
        return (self.radiance / (white + SMALLEST_SHARE * white.detach().mean())).log()

    def brightest(self, log_albedo: Float[Tensor, "points 3"]) -> Float[Tensor, ""]:
        """Log-albedo of the brightest paint (``LightStart.brightest``)."""
        around = self.near.others(log_albedo).median(1).values
        return around.amax(-1).quantile(self.learning.brightest)


def _near(points: SeenPoints, count: int) -> Int[Tensor, "points others"]:
    """Indices of the nearest neighbours of each point."""
    positions = points.centre.cpu().numpy()
    near = cKDTree(positions).query(positions, k=min(count + 1, len(positions)))[1]
    return torch.from_numpy(near.reshape(len(positions), -1)[:, 1:]).to(points.centre.device)


def _far(points: SeenPoints, each: int) -> Int[Tensor, "points others"]:
    """Indices of random points for each point, drawn with a fixed seed."""
    count = len(points.centre)
    drawn = torch.randint(count, (count, each), generator=torch.Generator().manual_seed(0))
    return drawn.to(points.centre.device)


class Fit(NamedTuple):
    """A light of least variation."""

    light: Light
    variation: float
    """Variation of log-albedo under it, mean over channels."""


def least_variation_light(
    variation: Variation, transport: Transport, begin: Light | None = None, share: float = 1.0
) -> Fit:
    """The light under which log-albedo varies least.

    Beside this variation, the loss has terms for the smoothness of the sky and of its colour, and two for what images
    determine only through indirect light: the colour of all light, which is near grey, and its brightness, under which
    the brightest albedo is near that of white paint. ``begin``: where the search begins; None: under a constant sky,
    without suns. ``share``: of the steps of a search.
    """
    learning, radiance = variation.learning, variation.radiance
    steps = max(1, round(share * learning.steps))
    if begin is None:
        level = float(radiance.mean()) / learning.mean_albedo
        begin = Light(radiance.new_full((transport.rows, 2 * transport.rows, 3), level), radiance.new_zeros(0, 3))
    log_sky, log_suns = begin.sky.log().requires_grad_(), begin.suns.log().requires_grad_()
    adam, learnt = Adam(ADAM_EPSILON), {"sky": log_sky, "suns": log_suns}
    white_log = math.log(learning.white)
    area = texel_solid_angles(transport.rows, 2 * transport.rows).to(log_sky)[..., None]
    for step in range(steps):
        log_albedo = variation.log_albedo(transport.white(Light(log_sky.exp(), log_suns.exp())))
        varied = variation.of(log_albedo).mean()
        loss = varied + learning.smoothness * unevenness(log_sky)
        loss = loss + learning.chroma_smoothness * unevenness(log_sky - log_sky.mean(-1, keepdim=True))
        total = ((log_sky.exp() * area).sum((0, 1)) + log_suns.exp().sum(0)).log()
        loss = loss + learning.colour * (total - total.mean()).square().mean()
        loss = loss + learning.white_paint * (variation.brightest(log_albedo) - white_log).square()
        loss.backward()
        adam.step(learnt, dict.fromkeys(learnt, learning.rate * (1 - step / steps)))
    return Fit(Light(log_sky.detach().exp(), log_suns.detach().exp()), float(varied.detach()))
