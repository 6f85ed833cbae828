"""Stage 2 of GS-IR: materials, light and irradiance by deferred split-sum shading with baked occlusion.

It starts from the surfels of stage 1 with new materials, a new light and zero irradiance. Occlusion is baked once,
before the first step, by rays from the lattice corners near surfels.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.learning.geometry import turning
from radiogs_core.learning.losses import environment_smoothness
from radiogs_core.learning.views import TrainingView
from radiogs_core.on_surfels.fit_geometry import surfels_of
from radiogs_core.on_surfels.light_start import SharedRays, starting_model
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import GEOMETRY, Surfels, inverse_sigmoid
from radiogs_core.transport.sampling import sphere_directions
from radiogs_core.transport.tracer import RAYS_AT_ONCE, SurfelTracer

from .model import Model
from .prefilter import filtered_light
from .settings import Budget, Variant
from .shading import View
from .volumes import IrradianceVolume, Lattice, OcclusionVolume, projection

MATERIALS = ("albedo", "roughness", "metallic")
"""Blended maps that the smoothness loss reads; metallic only if it is learnt."""


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2: bakes occlusion from stage 1's geometry and learns new materials and light. A ``contract.Stage``."""

    def __init__(self, run: Run[Variant, Budget], before: Mapping[str, Any]) -> None:
        variant, budget, extent = run.variant, run.budget, run.scene.extent
        super().__init__(run, budget.inverse_iterations, variant.view_share)
        learnt = surfels_of(before, run.device)
        self.occlusion, self.dark = None, None
        if variant.occlusion:
            lattice = Lattice.over(learnt, budget.occlusion_corners)
            self.occlusion = bake(learnt, lattice, Reach.of(variant, extent), budget.occlusion_directions)
            if variant.indirect:
                self.dark = IrradianceVolume.dark(lattice.of(budget.irradiance_corners))
        rays, values = SharedRays(learnt), variant.materials.start
        start = starting_model(rays, self.views, budget.light_height, values, self.generator)
        further = {"log_environment": start.log_environment}
        if variant.metallic:
            logit = inverse_sigmoid(variant.materials.start.metallic)
            further["metallic_logit"] = torch.full_like(learnt.roughness_logit, logit)
        if self.dark is not None:
            further["irradiance"] = self.dark.coefficients
        self.optimiser = SurfelOptimiser(start.surfels, further, rates_of(variant, budget, extent))

    @property
    def model(self) -> Model:
        """The model at the current iteration."""
        surfels, tensors = self.optimiser.surfels, self.optimiser.tensors
        return Model(
            surfels if self.variant.lr_scale > 0 else surfels.detached(*GEOMETRY),
            tensors["log_environment"],
            tensors.get("metallic_logit"),
            self.occlusion,
            None if self.dark is None else replace(self.dark, coefficients=tensors["irradiance"]),
        )

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """Weighted losses of a step on ``view``, by name."""
        weights, model, target = self.variant.materials.weights, self.model, view.over(0.0)
        light = SplitSumLight(filtered_light(model.environment, self.variant.texel_areas, self.variant.masking))
        shown = View.of(view.camera, model, model.surfels.albedo, self.depth_unit)
        shaded = shown.shaded(model, light, self.budget.occlusion_samples)
        maps = [shown.seen.images[name] for name in MATERIALS if name in shown.seen.images]
        smoothness = material_smoothness(torch.cat(maps, -1), target, shown.seen.alpha.detach() > 0)
        return {
            "shaded": weights.shaded * image_loss(view.where_valid(shown.image(shaded, self.variant.straight)), target),
            "smoothness": weights.smoothness * smoothness,
            "prior": weights.prior * material_prior(shown.points.roughness, shown.metallic),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
        }


CHANNELS = 5
"""Channels of albedo, roughness and metalness; the published loss divides by 5 even if metalness is not learnt."""


def image_loss(image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Mean L1 between display-sRGB images; values above 1 are clipped and have no gradient."""
    return (image.clamp(0, 1) - target).abs().mean()


def material_smoothness(
    materials: Float[Tensor, "height width channels"],
    guide: Float[Tensor, "height width 3"],
    covered: Bool[Tensor, "height width"],
) -> Float[Tensor, ""]:
    """Mean squared difference of neighbouring covered pixels, times exp(-|difference of ``guide``|).

    The mean is over all pairs of pixels along x and along y, and over ``CHANNELS`` channels. ``guide`` is the training
    image in display sRGB; its difference is averaged over channels.
    """
    total = materials.new_zeros(())
    for axis in (0, 1):
        pairs = covered.narrow(axis, 1, covered.shape[axis] - 1) & covered.narrow(axis, 0, covered.shape[axis] - 1)
        if pairs.numel():
            allowed = torch.exp(-guide.diff(dim=axis).abs().mean(-1)) * pairs
            total = total + (materials.diff(dim=axis).square().sum(-1) * allowed).mean() / CHANNELS
    return total


def material_prior(roughness: Float[Tensor, " points"], metallic: Float[Tensor, " points"] | None) -> Float[Tensor, ""]:
    """Mean of 1 - roughness plus mean metalness over the points; 0 without points."""
    smooth = 1 - roughness if metallic is None else 1 - roughness + metallic
    return smooth.sum() / max(1, len(smooth))


def rates_of(variant: Variant, budget: Budget, extent: float) -> dict[str, float]:
    """Learning rates by raw parameter; geometry has stage 1's final rates. ``extent``: the scene's, world units."""
    rates, before = variant.materials.rates, variant.geometry.rates
    late = variant.lr_scale * before.end_share
    return {
        "centre": variant.lr_scale * budget.geometry.rate * before.position_end * extent,
        "rotation": late * turning(budget.geometry.rate) * before.rotation,
        "log_scale": late * before.scale,
        "opacity_logit": late * before.opacity,
        "sh": 0.0,
        "sh_rest": 0.0,
        "albedo_logit": rates.albedo,
        "roughness_logit": rates.roughness,
        "metallic_logit": rates.metallic,
        "log_environment": rates.light,
        "irradiance": rates.irradiance,
    }


SOLID = 0.5
"""Opacity above which a ray counts as hitting an occluder at its mean depth."""


@dataclass(frozen=True)
class Reach:
    """Range of distances, world units, within which geometry occludes a probe."""

    nearest: float = 0.0
    """Distance at which rays start; nearer geometry does not occlude."""
    tau: float = torch.inf
    """Distance from which on geometry does not occlude."""

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Reach":
        """The range of a variant; ``extent``: the scene's extent, world units."""
        return cls(variant.nearest * extent, torch.inf if variant.tau is None else variant.tau * extent)

    def hidden(
        self, tracer: SurfelTracer, origin: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"]
    ) -> Bool[Tensor, " rays"]:
        """Whether each ray has an opacity above ``SOLID`` and a mean depth less than tau.

        Rays hit both sides of surfels, because a probe may lie on either side. The mean depth is blended over the whole
        ray and divided by its opacity, as a rasterizer does.
        """
        surfels, start = tracer.surfels, torch.full_like(origin[:, 0], self.nearest)
        hits = trace(
            tracer.bvh, tracer.geometry, surfels.sh[:, :1], surfels.sh.new_zeros(len(surfels), 0),
            origin, direction, start, back_from=torch.zeros_like(start),
        )  # fmt: skip
        opacity = 1 - hits.transmittance
        depth = hits.depth / torch.where(opacity > 0, opacity, 1.0)
        return (opacity > SOLID) & (depth < self.tau)


@torch.no_grad()
def bake(surfels: Surfels, lattice: Lattice, reach: Reach, directions: int) -> OcclusionVolume:
    """Bake a probe at every corner near a surfel; the other corners inherit the nearest probe, counted in grid steps.

    A probe holds the harmonics of M(w), which is 0 where ``Reach.hidden`` and 1 elsewhere, from ``directions``
    directions over the sphere. Needs at least one surfel.
    """
    near = corners_near(surfels, lattice)
    tracer = SurfelTracer(surfels).built()
    direction = sphere_directions(directions).to(lattice.low)
    onto = projection(direction)
    parts = []
    for some in lattice.positions(near).split(max(1, RAYS_AT_ONCE // directions)):
        hidden = reach.hidden(tracer, some.repeat_interleave(directions, 0), direction.repeat(len(some), 1))
        parts.append((~hidden).to(onto).view(len(some), directions) @ onto)
    return OcclusionVolume(lattice, inherited(near, lattice.corners), torch.cat(parts))


def corners_near(surfels: Surfels, lattice: Lattice) -> Int[Tensor, " near"]:
    """Sorted indices of the corners of all cells that a surfel touches, or in which shading reads the volume.

    The tested positions are each surfel's centre, the points one standard deviation along its axes in both directions,
    and the positions half a cell in front of these.
    """
    along = (
        surfels.frame.detach() * torch.nn.functional.pad(surfels.scale.detach(), (0, 1), value=lattice.half)[:, None]
    )
    tangent_u, tangent_v, ahead = along.unbind(-1)
    on = [surfels.centre.detach() + offset for offset in (0 * ahead, tangent_u, -tangent_u, tangent_v, -tangent_v)]
    index, _ = lattice.around(torch.cat([*on, *(position + ahead for position in on)]))
    return torch.unique(index)


def inherited(near: Int[Tensor, " near"], corners: int) -> Int[Tensor, " corners"]:
    """Index of the probe that each corner reads: its own index in ``near``, or the probe of the nearest corner there.

    Probes spread to the six neighbours in rounds, so each corner inherits a probe that is fewest grid steps away.
    """
    probe = torch.full((corners,) * 3, -1, dtype=torch.int64, device=near.device)
    probe.view(-1)[near] = torch.arange(len(near), device=near.device)
    while bool((probe < 0).any()):
        before = probe.clone()
        for axis in range(3):
            for here, there in ((0, 1), (1, 0)):
                own, neighbour = probe.narrow(axis, here, corners - 1), before.narrow(axis, there, corners - 1)
                own.copy_(torch.where(own < 0, neighbour, own))
    return probe.flatten()
