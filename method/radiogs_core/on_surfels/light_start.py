"""The initial materials and light of stage 2: the light under which albedo varies least, and the albedo under it.

The radiance of points that training pixels see is R = albedo (T E + B), where E is the light, texel by texel, T the
diffuse transport from it (visibility times cosine over pi), and B the indirect irradiance over pi, from the radiance of
the surfels. Any light E explains the images with the albedo R / (T E + B). Most surfaces have few paints, so this
module searches for the light for which the albedo differs least between points (l1 distance of logarithms). Pairs of
different chromaticity probably have different paints and count less. Distant points are compared too, because near
points alone do not determine the low frequencies of the light.

The light is a smooth sky of at most ``LightStart.rows`` rows, and suns beside it (``suns``). The problem is small (some
thousand points) and takes seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import interpolate

from ..instruments import fire
from ..learning.views import TrainingView
from ..order_statistics import quantile
from ..scene.colour import LINEAR_KNEE, srgb_decode
from ..surfels.harmonics import surfel_radiance
from ..surfels.surfels import Surfels
from ..transport.shading import lobe_albedo
from ..transport.splatting import towards
from .least_variation import Variation
from .lit_points import Light, SeenPoints, Transport, seen_points, transport_to
from .lit_points import SharedRays as SharedRays
from .model import LitSurfels
from .start_values import LightStart, StartValues
from .suns import Disc, drawn, with_suns

FEWEST_POINTS = 64
"""Least number of points from which a light is estimated: with fewer, hardly any pixel is opaque."""

NEVER_SEEN = 1e-6
"""Weight of the radiance along the normal, relative to the radiance towards a camera that the surfel faces."""


@dataclass(frozen=True)
class StartingModel(LitSurfels):
    """The initial model of stage 2."""

    searched: bool
    """Whether light and albedo were found by a search; otherwise both are constant."""


def starting_model(
    rays: SharedRays,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    finest: int = 0,
) -> StartingModel:
    """The initial model of stage 2: the surfels of stage 1 with initial materials, and an initial light.

    See ``starting_light_and_albedo`` for the arguments.
    """
    light, albedo, searched = starting_light_and_albedo(rays, views, rows, start, generator, finest)
    surfels = replace(rays.surfels.with_material(start.albedo, start.roughness), albedo_logit=torch.logit(albedo))
    return StartingModel(surfels, light.log(), searched)


def starting_light_and_albedo(
    rays: SharedRays,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    finest: int = 0,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"], bool]:
    """The initial light, a map of ``rows`` rows, and the initial albedo of the surfels of stage 1, both linear RGB.

    Both are constant if ``start.light`` is "constant" or if too few points are seen for a search; the last value is
    whether they were searched for. ``rays``: rays to the surfels of stage 1. ``finest``: rows of a map with suns, if
    that is more than ``rows``.
    """
    if start.light != "constant":
        found = light_and_albedo(rays, views, rows, start, generator, finest)
        if found is not None:
            return *found, True
    # The brightest covered pixels have the albedo ``start.white``.
    bright = quantile(lambda: (srgb_decode(view.image[view.mask > 0.5]).mean(-1) for view in views), start.brightest)
    level = max(bright or 0.0, LINEAR_KNEE) / start.white
    light = rays.surfels.centre.new_full((rows, 2 * rows, 3), level)
    return light, torch.full_like(rays.surfels.albedo_logit, start.albedo), False


def light_and_albedo(
    rays: SharedRays,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    finest: int = 0,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"]] | None:
    """A light map and the albedo under it of the surfels that ``rays`` hit, both linear RGB.

    Returns None, and counts ``lights_not_sought``, if fewer than ``FEWEST_POINTS`` points are found. ``rows`` and
    ``finest``: see ``starting_light_and_albedo``.
    """
    points = seen_points(rays.surfels, views, generator)
    too_few = len(points.centre) < FEWEST_POINTS
    fire(lights_not_sought=int(too_few))
    if too_few:
        return None
    variation = Variation(points, start.search)
    from_sky, received = transport_to(points, rays, min(rows, start.search.rows))
    light, discs = with_suns(variation, from_sky, points, rays, received)
    sky = enlarged(light.sky, max(rows, finest) if discs else rows)
    white = white_surfels(light, discs, points, from_sky, rays, start.search)
    return drawn(sky, discs, light.suns), albedo_under(white, mean_radiance(rays.surfels, views), start)


@torch.no_grad()
def mean_radiance(surfels: Surfels, views: tuple[TrainingView, ...]) -> Float[Tensor, "surfels 3"]:
    """The surfels' own radiance, linear RGB, averaged over the cameras that they face; along the normal if none."""
    normal = surfels.frame[..., 2]
    total = surfel_radiance(surfels.sh, normal[:, None])[:, 0] * NEVER_SEEN
    count = torch.full_like(normal[:, :1], NEVER_SEEN)
    for view in views:
        outgoing = towards(view.camera, surfels)
        facing = ((outgoing * normal).sum(-1, keepdim=True) > 0).to(normal.dtype)
        total = total + facing * surfel_radiance(surfels.sh, outgoing[:, None])[:, 0]
        count = count + facing
    return total / count


@torch.no_grad()
def white_surfels(
    light: Light, discs: Sequence[Disc], points: SeenPoints, from_sky: Transport, rays: SharedRays, search: LightStart
) -> Float[Tensor, "surfels 3"]:
    """Radiance, linear RGB, that the surfels would have under ``light`` if they were white.

    The sky's part is taken from nearby seen points; rays from the surfels themselves meet the ``discs`` of the suns.
    """
    centre, facing = rays.surfels.centre, rays.surfels.frame[..., 2]
    positions, normals = points.centre.cpu(), points.normal.cpu()
    bend = float(positions.std(0).norm()) * search.turned
    tree = cKDTree(torch.cat([positions, bend * normals], -1).numpy())
    own = torch.cat([centre, bend * facing], -1).cpu()
    near = torch.from_numpy(tree.query(own.numpy(), k=min(search.neighbours, len(positions)))[1])
    by_sky = from_sky.white(light).log()
    lit = by_sky[near.reshape(len(own), -1).to(by_sky.device)].mean(1).exp()
    for disc, energy in zip(discs, light.suns, strict=True):
        lit = lit + disc.arriving(rays, centre, facing)[:, None] * energy
    return lit


def albedo_under(
    white: Float[Tensor, "surfels 3"], radiance: Float[Tensor, "surfels 3"], start: StartValues
) -> Float[Tensor, "surfels 3"]:
    """Linear albedo of surfels that have the ``radiance``, and would have the radiance ``white`` if they were white.

    The specular lobe of the initial roughness sends its part of the radiance, by its hemispherical albedo.
    """
    return (radiance / white - lobe_albedo(radiance.new_tensor([start.roughness]))).clamp(*start.search.albedo_range)


def enlarged(light: Float[Tensor, "rows columns 3"], rows: int) -> Float[Tensor, "height width 3"]:
    """The light, bilinearly interpolated to ``rows`` rows."""
    if len(light) == rows:
        return light
    around = torch.cat([light[:, -1:], light, light[:, :1]], 1).permute(2, 0, 1)[None]
    scale = rows / len(light)
    large = interpolate(around, size=(rows, round(around.shape[-1] * scale)), mode="bilinear", align_corners=False)
    margin = (large.shape[-1] - 2 * rows) // 2
    return large[0, :, :, margin : margin + 2 * rows].permute(1, 2, 0)
