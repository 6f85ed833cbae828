"""The initial materials and light of stage 2: the light under which albedo varies least, and that albedo.

The radiance of points that training pixels see is R = albedo (T E + B), where E is the light, texel by texel, T the
diffuse transport from it (visibility times cosine over pi), and B the indirect irradiance over pi, from the radiance of
the surfels. Any light E explains the images with the albedo R / (T E + B). Most surfaces have few paints, so this
module searches for the light for which the albedo differs least between points (l1 distance of logarithms). Pairs of
different chromaticity probably have different paints and count less. Distant points are compared too, because near
points alone do not determine the low frequencies of the light.

The problem is small (some thousand points, at most ``LightStart.rows`` rows of light) and takes seconds.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn.functional import interpolate, max_pool2d, normalize

from ..instruments import fire
from ..learning.losses import unevenness
from ..learning.views import TrainingView
from ..order_statistics import quantile
from ..scene.colour import LINEAR_KNEE, srgb_decode
from ..scene.light import bilinear_texels
from ..surfels.harmonics import surfel_radiance
from ..surfels.surfels import Surfels
from ..transport.plan import EffectPlan
from ..transport.sampling import hemisphere_directions
from ..transport.shading import lobe_albedo
from ..transport.splatting import splat, towards
from ..transport.tracer import BACK_OFFSET, EVERYTHING, SurfelTracer, visibility_of
from .model import LitSurfels
from .start_values import LightStart, StartValues

POINTS = 2400
"""Number of points that are drawn from all training views together."""

FEWEST_POINTS = 64
"""Least number of points from which a light is estimated: with fewer, hardly any pixel is opaque."""

DIRECTIONS = 1024
"""Rays from each point. With fewer, few rays hit a sun of some degrees, and their noise makes the albedo vary: the
search for the least variation then prefers a broader light to the sun."""

POINTS_AT_ONCE = 128
"""Points whose rays are traced together."""

WHOLE = 0.99
"""Mask coverage from which a pixel shows a single surface."""

OPAQUE = 0.9
"""Coverage by surfels above which the depth of a pixel is that of a surface."""

ROUNDING = 1e-4
"""Constant under the root of the l1 distance of log-albedo: below its root the distance is quadratic."""

NEVER_SEEN = 1e-6
"""Weight of the radiance along the normal, relative to the radiance towards a camera that the surfel faces."""

SMALLEST_SHARE = 1e-4
"""Share of the mean irradiance that is added to it inside the logarithm."""


@dataclass(frozen=True)
class SeenPoints:
    """Points on surfaces, each seen by a training pixel that shows nothing else."""

    centre: Float[Tensor, "points 3"]
    """Positions in the world."""
    normal: Float[Tensor, "points 3"]
    """Unit normals in the world, facing the camera."""
    radiance: Float[Tensor, "points 3"]
    """Radiance of the pixels, linear RGB."""


@dataclass(frozen=True)
class Transport:
    """Diffuse light transport to points: a white Lambertian surface has the radiance ``direct`` E + ``indirect``."""

    rows: int
    """Rows of the light E; it has twice as many columns."""
    direct: Float[Tensor, "points texels"]
    """Radiance of the white surface due to unit radiance in each texel (row * columns + column) of the light."""
    indirect: Float[Tensor, "points 3"]
    """Radiance of the white surface due to light from other surfels, linear RGB."""

    def white(self, light: Float[Tensor, "rows columns 3"]) -> Float[Tensor, "points 3"]:
        """Radiance, linear RGB, of white Lambertian surfaces at the points under a light."""
        # Rows of three numbers would take five times as long, and their gradient ten times.
        return (light.flatten(0, 1).T.contiguous() @ self.direct.T).T + self.indirect


@dataclass(frozen=True)
class StartingModel(LitSurfels):
    """The initial model of stage 2."""

    searched: bool
    """Whether the light and albedo are those of a search; otherwise both are constant."""


def starting_model(
    learnt: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    two_sided: bool = True,
    plan: EffectPlan = EVERYTHING,
) -> StartingModel:
    """The initial model of stage 2: the surfels of stage 1 with initial materials, and an initial light.

    See ``starting_light_and_albedo`` for the arguments.
    """
    light, albedo, searched = starting_light_and_albedo(learnt, views, rows, start, generator, two_sided, plan)
    surfels = replace(learnt.with_material(start.albedo, start.roughness), albedo_logit=torch.logit(albedo))
    return StartingModel(surfels, light.log(), searched)


def starting_light_and_albedo(
    learnt: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    two_sided: bool = True,
    plan: EffectPlan = EVERYTHING,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"], bool]:
    """The initial light, [rows, 2 rows, 3], and the initial albedo of the surfels ``learnt`` by stage 1, linear RGB.

    Both are constant if ``start.light`` is "constant" or if too few points are seen for a search; the last value is
    whether they were searched for. ``two_sided``: whether rays also hit surfels from behind. ``plan``: whether the
    search simulates visibility and indirect light (see ``transport_to``).
    """
    if start.light != "constant":
        found = light_and_albedo(learnt, views, rows, start, generator, two_sided, plan)
        if found is not None:
            return *found, True
    level = white_light(views, start.white, start.brightest)
    light = learnt.centre.new_full((rows, 2 * rows, 3), level)
    return light, torch.full_like(learnt.albedo_logit, start.albedo), False


def light_and_albedo(
    surfels: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    start: StartValues,
    generator: torch.Generator,
    two_sided: bool = True,
    plan: EffectPlan = EVERYTHING,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"]] | None:
    """A light map of ``rows`` rows and the surfels' albedo under it, both linear RGB.

    Returns None, and counts ``lights_not_sought``, if fewer than ``FEWEST_POINTS`` points are found. ``two_sided`` and
    ``plan``: see ``transport_to``.
    """
    surfels = surfels.take(torch.arange(len(surfels), device=surfels.centre.device))
    points = seen_points(surfels, views, generator)
    too_few = len(points.centre) < FEWEST_POINTS
    fire(lights_not_sought=int(too_few))
    if too_few:
        return None
    transport = transport_to(points, surfels, min(rows, start.search.rows), generator, two_sided, plan)
    light = least_variation_light(points, transport, start.search)
    radiance = mean_radiance(surfels, views)
    return enlarged(light, rows), albedo_under(light, points, transport, surfels, radiance, start)


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
def seen_points(surfels: Surfels, views: tuple[TrainingView, ...], generator: torch.Generator) -> SeenPoints:
    """Points seen by random pixels that show a single surface, with positions and normals blended from the surfels."""
    samples = []
    for view in views:
        camera = view.camera
        seen = splat(camera, surfels, {}, depth_unit=1.0)
        at_edge = max_pool2d((view.mask < WHOLE).float()[None, None], 3, stride=1, padding=1)[0, 0] > 0
        length = seen.normal.norm(dim=-1)
        usable = torch.nonzero((~at_edge & (seen.alpha > OPAQUE) & (length > 0)).flatten())[:, 0]
        order = torch.randperm(len(usable), generator=generator, device=usable.device)
        chosen = usable[order[: -(-POINTS // len(views))]]
        position = camera.centre + camera.ray_directions() * seen.depth[..., None]
        maps = (position, normalize(seen.normal, dim=-1), srgb_decode(view.image))
        samples.append([values.reshape(-1, 3)[chosen] for values in maps])
    return SeenPoints(*(torch.cat(values) for values in zip(*samples, strict=True)))


@torch.no_grad()
def transport_to(
    points: SeenPoints,
    surfels: Surfels,
    rows: int,
    generator: torch.Generator,
    two_sided: bool = True,
    plan: EffectPlan = EVERYTHING,
) -> Transport:
    """Trace rays from points to the surfels, starting beyond the layer of surfels of the points' own surface.

    ``two_sided``: whether rays also hit surfels from behind. ``plan``: without visibility every direction reaches the
    light, without indirect light no other surfel lights a point, and without both no ray is traced.
    """
    tracer, count = SurfelTracer(surfels) if plan.traces else None, len(points.centre)
    beyond = BACK_OFFSET * float(surfels.scale.max(-1).values.median())
    direct = surfels.centre.new_zeros(count, 2 * rows * rows)
    indirect = surfels.centre.new_zeros(count, 3)
    features = surfels.centre.new_zeros(len(surfels), 0)
    for some in torch.arange(count, device=surfels.centre.device).split(POINTS_AT_ONCE):
        normal = points.normal[some]
        direction, weight = hemisphere_directions(normal, DIRECTIONS, generator)
        share = (direction * normal[:, None]).sum(-1).clamp(min=0) * weight / torch.pi
        visibility = torch.ones_like(share)
        if tracer is not None:
            start = share.new_full((share.numel(),), beyond)
            origin = points.centre[some].repeat_interleave(DIRECTIONS, 0)
            back_from = start if two_sided else None
            hits = tracer.trace_from(origin, direction.flatten(0, 1), features, start, back_from)
            seen, whole = visibility_of(hits)
            if plan.visibility:
                visibility = seen.view(share.shape)
            if plan.indirect:
                arriving = (hits.radiance * whole[:, None]).view(*share.shape, 3)
                indirect[some] = (share[..., None] * arriving).sum(1)
        texel, part = bilinear_texels(direction, rows, 2 * rows)
        received = (share * visibility)[..., None] * part
        direct[some] = direct[some].scatter_add(1, texel.flatten(1), received.flatten(1))
    return Transport(rows, direct, indirect)


def least_variation_light(
    points: SeenPoints, transport: Transport, learning: LightStart
) -> Float[Tensor, "rows columns 3"]:
    """The light, linear RGB, under which log-albedo varies least between near and distant points.

    Beside this variation, the loss has terms for the smoothness of the light and of its colour, and one that keeps the
    brightest albedo near that of white paint, because images determine the brightness of the light only through
    indirect light.
    """
    radiance = points.radiance.clamp(min=LINEAR_KNEE)
    near, far = _near_pairs(points, learning), _far_pairs(points, learning)
    level, white_log = float(radiance.mean()) / learning.mean_albedo, math.log(learning.white)
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
        colour = (light - light.mean(-1, keepdim=True)).abs().mean() / light.detach().mean()
        around = log_albedo.index_select(0, near.second).view(len(log_albedo), -1, 3).median(1).values
        brightest = around.amax(-1).quantile(learning.brightest)
        loss = variation + learning.smoothness * unevenness(log_light)
        loss = loss + learning.chroma_smoothness * unevenness(log_light - log_light.mean(-1, keepdim=True))
        loss = loss + learning.colour * colour + learning.white_paint * (brightest - white_log).square()
        adam.zero_grad()
        loss.backward()
        adam.step()
    return log_light.detach().exp()


class _Pairs(NamedTuple):
    """Pairs of points, with weights."""

    first: Int[Tensor, " pairs"]
    """Index of the first point of each pair."""
    second: Int[Tensor, " pairs"]
    """Index of the second point of each pair."""
    weight: Float[Tensor, " pairs"]
    """Weights; they sum to 1."""

    @classmethod
    def of(cls, first: Tensor, second: Tensor, points: SeenPoints, learning: LightStart) -> "_Pairs":
        """Pairs weighted by the similarity of their chromaticities."""
        logarithm = points.radiance.clamp(min=LINEAR_KNEE).log()
        chroma = logarithm - logarithm.mean(-1, keepdim=True)
        apart = (chroma[first] - chroma[second]).square().sum(-1)
        weight = torch.exp(-apart / (2 * learning.same_paint**2))
        return cls(first, second, weight / weight.sum().clamp(min=torch.finfo(weight.dtype).tiny))


def _near_pairs(points: SeenPoints, learning: LightStart) -> _Pairs:
    """Pairs of each point and its nearest neighbours."""
    positions = points.centre.cpu().numpy()
    near = cKDTree(positions).query(positions, k=min(learning.neighbours + 1, len(positions)))[1]
    second = torch.from_numpy(near.reshape(len(positions), -1)[:, 1:]).to(points.centre.device)
    first = torch.arange(len(positions), device=second.device).repeat_interleave(second.shape[1])
    return _Pairs.of(first, second.flatten(), points, learning)


def _far_pairs(points: SeenPoints, learning: LightStart) -> _Pairs:
    """Pairs of each point and random points, drawn with a fixed seed."""
    count, device = len(points.centre), points.centre.device
    drawn = torch.randint(count, (count * learning.far,), generator=torch.Generator().manual_seed(0))
    first = torch.arange(count, device=device).repeat_interleave(learning.far)
    return _Pairs.of(first, drawn.to(device), points, learning)


def _differences(log_albedo: Float[Tensor, "points 3"], pairs: _Pairs) -> Float[Tensor, "pairs 3"]:
    """Absolute differences of log-albedo, smoothed at zero.

    ``index_select``, whose gradient takes a fraction of the time of that of an index in brackets.
    """
    first, second = log_albedo.index_select(0, pairs.first), log_albedo.index_select(0, pairs.second)
    return ((first - second).square() + ROUNDING).sqrt()


def _mean(values: Float[Tensor, "pairs 3"], pairs: _Pairs) -> Float[Tensor, ""]:
    """Weighted mean over pairs, and mean over channels."""
    return (pairs.weight[:, None] * values).sum() / 3


def albedo_under(
    light: Float[Tensor, "rows columns 3"],
    points: SeenPoints,
    transport: Transport,
    surfels: Surfels,
    radiance: Float[Tensor, "surfels 3"],
    start: StartValues,
) -> Float[Tensor, "surfels 3"]:
    """Linear albedo of each surfel under ``light``, from its ``radiance`` and the irradiance at nearby seen points.

    The specular lobe of the initial roughness sends its part of the radiance, by its hemispherical albedo.
    """
    learning, lobe = start.search, lobe_albedo(radiance.new_tensor([start.roughness]))
    white = transport.white(light).log()
    positions, normals = points.centre.cpu(), points.normal.cpu()
    bend = float(positions.std(0).norm()) * learning.turned
    tree = cKDTree(torch.cat([positions, bend * normals], -1).numpy())
    own = torch.cat([surfels.centre.detach(), bend * surfels.frame[..., 2].detach()], -1).cpu()
    near = torch.from_numpy(tree.query(own.numpy(), k=min(learning.neighbours, len(positions)))[1])
    lit = white[near.reshape(len(own), -1).to(white.device)].mean(1).exp()
    low, high = learning.albedo_range
    return (radiance / lit - lobe).clamp(low, high)


def enlarged(light: Float[Tensor, "rows columns 3"], rows: int) -> Float[Tensor, "height width 3"]:
    """The light, bilinearly interpolated to ``rows`` rows."""
    if len(light) == rows:
        return light
    around = torch.cat([light[:, -1:], light, light[:, :1]], 1).permute(2, 0, 1)[None]
    scale = rows / len(light)
    large = interpolate(around, size=(rows, round(around.shape[-1] * scale)), mode="bilinear", align_corners=False)
    margin = (large.shape[-1] - 2 * rows) // 2
    return large[0, :, :, margin : margin + 2 * rows].permute(1, 2, 0)


def white_light(views: tuple[TrainingView, ...], white: float, brightest: float) -> float:
    """Radiance of the constant light under which the brightest surfaces in the views have the albedo ``white``.

    ``brightest``: quantile of the covered pixels' linear brightness that counts as the brightest.
    """
    brightness = quantile(lambda: (srgb_decode(view.image[view.mask > 0.5]).mean(-1) for view in views), brightest)
    return max(brightness or 0.0, LINEAR_KNEE) / white
