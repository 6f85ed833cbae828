"""The materials and the light that stage 2 starts with: the light under which albedo varies least, and that albedo.

Points that training pixels see send out R = albedo (T E + B): E is the light, texel by texel, T the diffuse transport
from it (visibility, cosine over pi), and B the indirect irradiance over pi, from the radiance of the surfels.
Any light explains the images with some albedo R / (T E + B). Most surfaces are of few paints, so the light is sought
for which this albedo differs least, in l1 of its logarithm, between points. Pairs of another
chromaticity are probably of another paint and count less. Points far from each other are compared as well: near ones
alone leave a gradient of the light that no two of them see.

The problem is small (some thousand points, at most ``ROWS`` rows of light) and is solved in seconds.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import interpolate, max_pool2d, normalize

from ..instruments import fire
from ..learning.views import TrainingView
from ..order_statistics import quantile
from ..scene.colour import LINEAR_KNEE, srgb_decode
from ..scene.light import bilinear_texels
from ..surfels.harmonics import surfel_radiance
from ..surfels.surfels import Surfels
from ..transport.sampling import hemisphere_directions
from ..transport.splatting import splat, towards
from ..transport.tracer import BACK_OFFSET, SurfelTracer, visibility_of
from .model import LitSurfels
from .start_values import LightStart, StartValues

ROWS = 16
"""Rows of light that are sought at most; a larger map starts as this one, enlarged."""

POINTS = 2400
"""Points that the training views are asked for, all together."""

FEWEST_POINTS = 64
"""Points without which no light is sought: surfels that leave hardly a pixel solid say nothing about it."""

DIRECTIONS = 1024
"""Rays from each point. With fewer, a sun of some degrees is met by few of them, and the noise of what it sends makes
albedo vary: a search for the least variation then flees from the sun to a broader light."""

POINTS_AT_ONCE = 128
"""Points whose rays are traced together."""

WHOLE = 0.99
"""Coverage above which a pixel sees one surface only."""

OPAQUE = 0.9
"""Coverage by surfels above which the depth of a pixel is that of a surface."""

ROUNDING = 1e-4
"""Square of the difference in log-albedo below which l1 turns into a square."""

NEVER_SEEN = 1e-6
"""Weight of the radiance along the normal beside that towards cameras."""

SMALLEST_SHARE = 1e-4
"""Irradiance is kept above this share of its mean inside the logarithm."""


@dataclass(frozen=True)
class SeenPoints:
    """Points on surfaces that training pixels see whole.

    centre: world. normal: unit, towards the camera. radiance: linear, what the pixel shows.
    """

    centre: Float[Tensor, "points 3"]
    normal: Float[Tensor, "points 3"]
    radiance: Float[Tensor, "points 3"]


@dataclass(frozen=True)
class Transport:
    """How light reaches points: a white Lambert surface there sends out the radiance ``direct`` E + ``indirect``.

    direct: from each texel (row * columns + column) of a light of ``rows`` rows. indirect: linear radiance.
    """

    rows: int
    direct: Float[Tensor, "points texels"]
    indirect: Float[Tensor, "points 3"]

    def white(self, light: Float[Tensor, "rows columns 3"]) -> Float[Tensor, "points 3"]:
        """Linear radiance of white surfaces under a light."""
        return self.direct @ light.flatten(0, 1) + self.indirect


def starting_model(
    learnt: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    two_sided: bool = True,
) -> LitSurfels:
    """The surfels that stage 1 has learnt with starting materials, and a light; see ``starting_light_and_albedo``."""
    light, albedo = starting_light_and_albedo(learnt, views, rows, start, generator, two_sided)
    surfels = learnt.made_of(start.albedo, start.roughness)
    return LitSurfels(replace(surfels, albedo_logit=torch.logit(albedo)), light.log())


def starting_light_and_albedo(
    learnt: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    two_sided: bool = True,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"]]:
    """A light of ``rows`` rows and the albedo of the surfels that stage 1 has learnt, both linear.

    Both are constant where ``start`` says so, and where too few points are seen to look for another light.
    ``two_sided``: whether rays meet surfels from behind (see ``light_and_albedo``).
    """
    found = None
    if start.light == "least-variation":
        found = light_and_albedo(learnt, views, rows, start.search, generator, two_sided)
    if found is not None:
        return found
    level = white_light(views, start.white, start.brightest)
    return learnt.centre.new_full((rows, 2 * rows, 3), level), torch.full_like(learnt.albedo_logit, start.albedo)


def light_and_albedo(
    surfels: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    learning: LightStart,
    generator: torch.Generator,
    two_sided: bool = True,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"]] | None:
    """A light map of ``rows`` rows and the surfels' albedo under it, both linear. ``two_sided``: see ``transport_to``.

    None, counted as ``lights_not_sought``, where fewer than ``FEWEST_POINTS`` points are seen whole.
    """
    surfels = surfels.take(torch.arange(len(surfels), device=surfels.centre.device))
    points = seen_points(surfels, views, generator)
    too_few = len(points.centre) < FEWEST_POINTS
    fire(lights_not_sought=int(too_few))
    if too_few:
        return None
    transport = transport_to(points, surfels, min(rows, ROWS), generator, two_sided)
    light = least_variation_light(points, transport, learning)
    radiance = mean_radiance(surfels, views)
    return enlarged(light, rows), albedo_under(light, points, transport, surfels, radiance, learning)


def mean_radiance(surfels: Surfels, views: tuple[TrainingView, ...]) -> Float[Tensor, "surfels 3"]:
    """The surfels' own linear radiance, averaged over the cameras that they face; along the normal where none does."""
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
def seen_points(surfels: Surfels, views: tuple[TrainingView, ...], generator: torch.Generator) -> SeenPoints:
    """Random pixels of all views that show one surface; its place and normal are those of the surfels."""
    found = []
    for view in views:
        camera = view.camera
        seen = splat(camera, surfels, {}, depth_unit=1.0)
        beside = max_pool2d((view.mask < WHOLE).float()[None, None], 3, stride=1, padding=1)[0, 0] > 0
        length = seen.normal.norm(dim=-1)
        usable = torch.nonzero((~beside & (seen.alpha > OPAQUE) & (length > 0)).flatten())[:, 0]
        order = torch.randperm(len(usable), generator=generator, device=usable.device)
        chosen = usable[order[: -(-POINTS // len(views))]]
        place = camera.centre + camera.ray_directions() * seen.depth[..., None]
        maps = (place, normalize(seen.normal, dim=-1), srgb_decode(view.image))
        found.append([values.reshape(-1, 3)[chosen] for values in maps])
    return SeenPoints(*(torch.cat(values) for values in zip(*found, strict=True)))


@torch.no_grad()
def transport_to(
    points: SeenPoints, surfels: Surfels, rows: int, generator: torch.Generator, two_sided: bool = True
) -> Transport:
    """Trace rays from points to the surfels, beyond the layer that surfels of the points' own surface make up.

    ``two_sided``: whether surfels are met from behind, too.
    """
    tracer, count = SurfelTracer(surfels), len(points.centre)
    beyond = BACK_OFFSET * float(surfels.scale.max(-1).values.median())
    direct = surfels.centre.new_zeros(count, 2 * rows * rows)
    indirect = surfels.centre.new_zeros(count, 3)
    features = surfels.centre.new_zeros(len(surfels), 0)
    for some in torch.arange(count, device=surfels.centre.device).split(POINTS_AT_ONCE):
        normal = points.normal[some]
        direction, weight = hemisphere_directions(normal, DIRECTIONS, generator)
        share = (direction * normal[:, None]).sum(-1).clamp(min=0) * weight / torch.pi
        start = share.new_full((share.numel(),), beyond)
        origin = points.centre[some].repeat_interleave(DIRECTIONS, 0)
        back_from = start if two_sided else None
        hits = tracer.trace_from(origin, direction.flatten(0, 1), features, start, back_from)
        visibility, whole = visibility_of(hits)
        arriving = (hits.radiance * whole[:, None]).view(*share.shape, 3)
        indirect[some] = (share[..., None] * arriving).sum(1)
        texel, part = bilinear_texels(direction, rows, 2 * rows)
        received = (share * visibility.view(share.shape))[..., None] * part
        direct[some] = direct[some].scatter_add(1, texel.flatten(1), received.flatten(1))
    return Transport(rows, direct, indirect)


def least_variation_light(
    points: SeenPoints, transport: Transport, learning: LightStart
) -> Float[Tensor, "rows columns 3"]:
    """The light under which log-albedo varies least between points, near and far; linear radiance.

    Beside the variation it pays for its own roughness, for colour, and for a brightness under which the brightest
    albedo is not that of white paint: the images determine it only as far as there is indirect light.
    """
    radiance = points.radiance.clamp(min=LINEAR_KNEE)
    near, far = _near_pairs(points, learning), _far_pairs(points, learning)
    level = float(radiance.mean()) / learning.mean_albedo
    log_light = radiance.new_full((transport.rows, 2 * transport.rows, 3), level).log().requires_grad_()
    adam = torch.optim.Adam([log_light], lr=learning.rate)
    for step in range(learning.steps):
        adam.param_groups[0]["lr"] = learning.rate * (1 - step / learning.steps)
        light = log_light.exp()
        white = transport.white(light)
        log_albedo = (radiance / (white + SMALLEST_SHARE * white.detach().mean())).log()
        apart = learning.other_paint * torch.tanh(_differences(log_albedo, far) / learning.other_paint)
        variation = (1 - learning.far_share) * _mean(_differences(log_albedo, near), near)
        variation = variation + learning.far_share * _mean(apart, far)
        around, down = log_light - log_light.roll(1, 1), log_light[1:] - log_light[:-1]
        colour = (light - light.mean(-1, keepdim=True)).abs().mean() / light.detach().mean()
        brightest = log_albedo.amax(-1).quantile(learning.brightest)
        loss = variation + learning.smoothness * (around.square().mean() + down.square().mean())
        loss = loss + learning.colour * colour + learning.white_paint * (brightest - learning.white_log).square()
        adam.zero_grad()
        loss.backward()
        adam.step()
    return log_light.detach().exp()


class _Pairs(NamedTuple):
    """Pairs of points, and how much each counts (all together: 1, or 0 where there are none)."""

    first: Int[Tensor, " pairs"]
    second: Int[Tensor, " pairs"]
    weight: Float[Tensor, " pairs"]

    @classmethod
    def of(cls, first: Tensor, second: Tensor, points: SeenPoints, learning: LightStart) -> "_Pairs":
        """Pairs that count by how alike their chromaticity is."""
        logarithm = points.radiance.clamp(min=LINEAR_KNEE).log()
        chroma = logarithm - logarithm.mean(-1, keepdim=True)
        apart = (chroma[first] - chroma[second]).square().sum(-1)
        weight = torch.exp(-apart / (2 * learning.same_paint**2))
        return cls(first, second, weight / weight.sum().clamp(min=torch.finfo(weight.dtype).tiny))


def _near_pairs(points: SeenPoints, learning: LightStart) -> _Pairs:
    """Each point with its nearest ones."""
    places = points.centre.cpu().numpy()
    near = cKDTree(places).query(places, k=min(learning.neighbours + 1, len(places)))[1]
    second = torch.from_numpy(near.reshape(len(places), -1)[:, 1:]).to(points.centre.device)
    first = torch.arange(len(places), device=second.device).repeat_interleave(second.shape[1])
    return _Pairs.of(first, second.flatten(), points, learning)


def _far_pairs(points: SeenPoints, learning: LightStart) -> _Pairs:
    """Each point with some of all points, the same ones in every search."""
    count, device = len(points.centre), points.centre.device
    drawn = torch.randint(count, (count * learning.far,), generator=torch.Generator().manual_seed(0))
    first = torch.arange(count, device=device).repeat_interleave(learning.far)
    return _Pairs.of(first, drawn.to(device), points, learning)


def _differences(log_albedo: Float[Tensor, "points 3"], pairs: _Pairs) -> Float[Tensor, "pairs 3"]:
    """Magnitudes, rounded off at zero."""
    return ((log_albedo[pairs.first] - log_albedo[pairs.second]).square() + ROUNDING).sqrt()


def _mean(values: Float[Tensor, "pairs 3"], pairs: _Pairs) -> Float[Tensor, ""]:
    """Mean over pairs, as they count, and channels."""
    return (pairs.weight[:, None] * values).sum() / 3


def albedo_under(
    light: Float[Tensor, "rows columns 3"],
    points: SeenPoints,
    transport: Transport,
    surfels: Surfels,
    radiance: Float[Tensor, "surfels 3"],
    learning: LightStart,
) -> Float[Tensor, "surfels 3"]:
    """The albedo of each surfel under a light, from its own ``radiance`` and the light on the seen points near it."""
    white = transport.white(light).log()
    places, normals = points.centre.cpu(), points.normal.cpu()
    bend = float(places.std(0).norm()) * learning.turned
    tree = cKDTree(torch.cat([places, bend * normals], -1).numpy())
    own = torch.cat([surfels.centre.detach(), bend * surfels.frame[..., 2].detach()], -1).cpu()
    near = torch.from_numpy(tree.query(own.numpy(), k=min(learning.neighbours, len(places)))[1])
    lit = white[near.reshape(len(own), -1).to(white.device)].mean(1).exp()
    low, high = learning.albedo_range
    return (radiance / lit).clamp(low, high)


def enlarged(light: Float[Tensor, "rows columns 3"], rows: int) -> Float[Tensor, "height width 3"]:
    """The light on a map of ``rows`` rows."""
    if len(light) == rows:
        return light
    around = torch.cat([light[:, -1:], light, light[:, :1]], 1).permute(2, 0, 1)[None]
    scale = rows / len(light)
    large = interpolate(around, size=(rows, round(around.shape[-1] * scale)), mode="bilinear", align_corners=False)
    margin = (large.shape[-1] - 2 * rows) // 2
    return large[0, :, :, margin : margin + 2 * rows].permute(1, 2, 0)


def white_light(views: tuple[TrainingView, ...], white: float, brightest: float) -> float:
    """Constant radiance under which the brightest surfaces of the views are paint of albedo ``white``.

    ``brightest``: quantile of the covered pixels that counts as the brightest.
    """
    found = quantile(lambda: (srgb_decode(view.image[view.mask > 0.5]).mean(-1) for view in views), brightest)
    return max(found or 0.0, LINEAR_KNEE) / white
