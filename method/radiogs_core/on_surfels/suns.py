"""Suns and small lamps: a few discs of light at infinity, found by the shadows that they cast and by their shading.

A sky of some rows cannot hold a sun: its shadows would have no edges, and edges that images show would become paint.
Under the sky that is found first, a disc in one of many directions is tried; the disc is kept under which log-albedo
varies least, and sky and discs are fitted together. This goes on while a disc is ``WORTH`` it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ..scene.light import bilinear_texels, texel_solid_angles
from ..transport.sampling import GOLDEN_ANGLE, tangent_frame
from .least_variation import Variation, least_variation_light
from .lit_points import Light, SeenPoints, SharedRays, Transport, sphere

MOST = 4
"""Largest number of discs."""

WORTH = 0.003
"""Share of the variation under a sky alone by which each disc has to lower it, in as many further steps without it."""

TRIAL = 1 / 3
"""Share of a search's steps after which it is judged whether a disc is worth it."""

RADII = (0.25, 1.0, 2.5, 5.0, 10.0)
"""Radii of discs that are tried, degrees; the first is the sun's."""

REFINED = (6.0, 2.0)
"""Radii, in degrees, of the neighbourhoods of the best direction that are searched in turn, in ``TRIED`` directions."""

TRIED = 32
"""Directions that are tried in a neighbourhood."""

SAMPLES = 16
"""Directions over a disc."""

RATIOS = (0.1, 0.25, 0.5, 1.0, 2.0)
"""Brightness of white surfaces under the disc that is tried, on average, as shares of their brightness under the rest
of the light."""

LIT = 0.1
"""Least irradiance that points receive on average from a disc, as a share of the largest of all that are tried."""

COLUMNS_AT_ONCE = 128
"""Discs that are tried together."""

DRAWN = 1024
"""Directions over a disc that is drawn into a map."""


@dataclass(frozen=True)
class Disc:
    """A disc of constant radiance at infinity."""

    direction: Float[Tensor, "3"]
    """Unit direction towards its centre, in the world."""
    radius: float
    """Angular radius, degrees."""

    def directions(self, count: int) -> Float[Tensor, "count 3"]:
        """Unit directions over the disc, evenly spread, from its centre outwards."""
        order = torch.arange(count, dtype=torch.float64, device=self.direction.device)
        polar = ((order + 0.5) / count).sqrt() * math.radians(self.radius)
        azimuth = order * GOLDEN_ANGLE
        about = torch.stack([polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()], -1)
        return about.to(self.direction) @ tangent_frame(self.direction).T

    def arriving(
        self, rays: SharedRays, centre: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"]
    ) -> Float[Tensor, " points"]:
        """Radiance of white surfaces due to the disc, if it gives unhidden surfaces that face it unit irradiance."""
        return rays.arriving(centre, normal, self.directions(SAMPLES))[0].mean(1)


def with_suns(
    variation: Variation,
    transport: Transport,
    points: SeenPoints,
    rays: SharedRays,
    received: Float[Tensor, "points directions"],
) -> tuple[Light, tuple[Disc, ...]]:
    """The light under which log-albedo varies least, and the discs of its suns.

    ``transport``: from the sky. ``received``: V cos / pi along the directions of ``sphere``.
    """
    discs: tuple[Disc, ...] = ()
    found = least_variation_light(variation, transport)
    worth = WORTH * found.variation
    while len(discs) < MOST:
        disc, arriving, energy = likeliest(variation, transport.white(found.light), points, rays, received)
        further = transport.with_sun(arriving)
        begin = Light(found.light.sky, torch.cat([found.light.suns, energy[None]]))
        tried = least_variation_light(variation, further, begin, TRIAL)
        without = least_variation_light(variation, transport, found.light, TRIAL)
        if not tried.variation < without.variation - worth:  # also if it is not a number
            break
        found, transport, discs = tried, further, (*discs, disc)
    if discs:
        found = least_variation_light(variation, transport, found.light)
    return found.light, discs


def likeliest(
    variation: Variation,
    white: Float[Tensor, "points 3"],
    points: SeenPoints,
    rays: SharedRays,
    received: Float[Tensor, "points directions"],
) -> tuple[Disc, Float[Tensor, " points"], Float[Tensor, "3"]]:
    """The disc that lowers the variation most beside a light that gives white surfaces the radiance ``white``.

    Also returns V cos / pi of each point and the disc, and the irradiance by the disc. ``received``: see ``with_suns``.
    """
    direction = sphere(points.centre)[_best(variation, white, received)[0]]
    for radius in REFINED:
        tried = torch.cat([direction[None], Disc(direction, radius).directions(TRIED)])
        arriving, _ = rays.arriving(points.centre, points.normal, tried)
        direction = tried[_best(variation, white, arriving)[0]]
    discs = [Disc(direction, radius) for radius in RADII]
    columns = torch.stack([disc.arriving(rays, points.centre, points.normal) for disc in discs], 1)
    index, energy = _best(variation, white, columns)
    return discs[index], columns[:, index], energy


@torch.no_grad()
def _best(
    variation: Variation, white: Float[Tensor, "points 3"], columns: Float[Tensor, "points discs"]
) -> tuple[int, Float[Tensor, "3"]]:
    """Index of the disc that lowers the variation most, and its irradiance, in the colour of the rest of the light.

    ``columns``: V cos / pi of each point and disc. Brightness alone is compared, with each of ``RATIOS``. Discs that
    give points less than ``LIT`` are excluded.
    """
    shown, level, least = variation.radiance.mean(-1, keepdim=True).log(), white.mean(-1, keepdim=True), math.inf
    best, ratio, mean = 0, RATIOS[0], columns.mean(0)
    for some in torch.nonzero(mean >= LIT * mean.max())[:, 0].split(COLUMNS_AT_ONCE):
        for each in RATIOS:
            under = level + each * level.mean() * columns[:, some] / mean[some]
            varied, index = variation.of(shown - under.log()).min(0)
            if float(varied) < least:
                least, best, ratio = float(varied), int(some[index]), each
    return best, ratio * white.mean(0) / mean[best]


def drawn(
    sky: Float[Tensor, "rows columns 3"], discs: Sequence[Disc], irradiance: Float[Tensor, "suns 3"]
) -> Float[Tensor, "rows columns 3"]:
    """A sky with discs of some irradiance, linear radiance; a disc keeps its energy at any number of rows."""
    rows, columns = sky.shape[:2]
    drawn, solid = sky.flatten(0, 1).clone(), texel_solid_angles(rows, columns).to(sky).expand(-1, columns).flatten()
    for disc, energy in zip(discs, irradiance, strict=True):
        texel, part = bilinear_texels(disc.directions(DRAWN), rows, columns)
        share = torch.zeros_like(solid).index_add_(0, texel.flatten(), part.flatten() / DRAWN)
        drawn += (share / solid)[:, None] * energy
    return drawn.view_as(sky)
