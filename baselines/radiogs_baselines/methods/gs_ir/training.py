"""Stage 2 of GS-IR: materials, light and irradiance by deferred split-sum shading, under occlusion baked before.

It starts from the surfels of stage 1 with new materials, a new light and no irradiance yet. Occlusion is baked once,
before the first step: rays from the corners of a lattice that surfels are near.
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
from radiogs_core.on_surfels.light_start import starting_model
from radiogs_core.on_surfels.split_sum import SplitSumLight
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import GEOMETRY, Surfels, inverse_sigmoid
from radiogs_core.transport.tracer import RAYS_AT_ONCE, SurfelTracer

from .irradiance import IrradianceVolume
from .lattice import Lattice
from .model import Model
from .occlusion import OcclusionVolume, projection, sphere_directions
from .prefilter import filtered_light
from .settings import Budget, Variant
from .shading import View

MATERIALS = ("albedo", "roughness", "metallic")
"""Blended maps that are kept smooth; the last where there is one."""


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2. Bakes occlusion by the geometry of stage 1, starts materials and light afresh. A ``contract.Stage``."""

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
        start = starting_model(learnt, self.views, budget.light_height, variant.materials.start, self.generator)
        further = {"log_environment": start.log_environment}
        if variant.metallic:
            logit = inverse_sigmoid(variant.materials.start.metallic)
            further["metallic_logit"] = torch.full_like(learnt.roughness_logit, logit)
        if self.dark is not None:
            further["irradiance"] = self.dark.coefficients
        self.optimiser = SurfelOptimiser(start.surfels, further, rates_of(variant, budget, extent))

    @property
    def model(self) -> Model:
        """What is learnt so far."""
        surfels, tensors = self.optimiser.surfels, self.optimiser.tensors
        return Model(
            surfels if self.variant.lr_scale > 0 else frozen(surfels),
            tensors["log_environment"],
            tensors.get("metallic_logit"),
            self.occlusion,
            None if self.dark is None else replace(self.dark, coefficients=tensors["irradiance"]),
        )

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step by name, if it looks at ``view``."""
        weights, model, target = self.variant.materials.weights, self.model, view.over(0.0)
        light = SplitSumLight(filtered_light(model.environment, self.variant.texel_areas))
        shown = View.of(view.camera, model, model.surfels.albedo, self.depth_unit)
        shaded = shown.shaded(model, light, self.budget.occlusion_samples)
        maps = [shown.seen.images[name] for name in MATERIALS if name in shown.seen.images]
        smoothness = material_smoothness(torch.cat(maps, -1), target, shown.seen.alpha.detach() > 0)
        return {
            "shaded": weights.shaded * image_loss(shown.image(shaded, self.variant.straight), target),
            "smoothness": weights.smoothness * smoothness,
            "prior": weights.prior * material_prior(shown.points.roughness, shown.metallic),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
        }

    def product(self) -> dict[str, Any]:
        """The model as plain tensors (see ``Model.tensors``)."""
        return self.model.tensors()


CHANNELS = 5
"""Albedo, roughness and metalness: what the published smoothness is a mean over, whether metalness is learnt or not."""


def image_loss(image: Float[Tensor, "height width 3"], target: Float[Tensor, "height width 3"]) -> Float[Tensor, ""]:
    """Mean L1 between display-sRGB images. What is brighter than 1 is cut off, and has no gradient."""
    return (image.clamp(0, 1) - target).abs().mean()


def material_smoothness(
    materials: Float[Tensor, "height width channels"],
    guide: Float[Tensor, "height width 3"],
    covered: Bool[Tensor, "height width"],
) -> Float[Tensor, ""]:
    """Mean squared difference of neighbouring covered pixels, times exp(-|difference of ``guide``|).

    The mean is over all pairs of pixels along x and along y, and ``CHANNELS`` channels; ``guide`` is the training image
    in display sRGB, whose channels' differences are averaged.
    """
    total = materials.new_zeros(())
    for axis in (0, 1):
        pairs = covered.narrow(axis, 1, covered.shape[axis] - 1) & covered.narrow(axis, 0, covered.shape[axis] - 1)
        if pairs.numel():
            allowed = torch.exp(-guide.diff(dim=axis).abs().mean(-1)) * pairs
            total = total + (materials.diff(dim=axis).square().sum(-1) * allowed).mean() / CHANNELS
    return total


def material_prior(roughness: Float[Tensor, " points"], metallic: Float[Tensor, " points"] | None) -> Float[Tensor, ""]:
    """Mean of 1 - roughness plus that of the metalness; 0 for no points."""
    smooth = 1 - roughness if metallic is None else 1 - roughness + metallic
    return smooth.sum() / max(1, len(smooth))


def rates_of(variant: Variant, budget: Budget, extent: float) -> dict[str, float]:
    """Learning rates by raw parameter; those of geometry are what stage 1 ends with. ``extent``: the scene's."""
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


def frozen(surfels: Surfels) -> Surfels:
    """The surfels whose geometry has no gradient: it is neither computed nor stepped on."""
    return surfels.detached(*GEOMETRY)


SOLID = 0.5
"""Opacity along a ray above which its depth is that of an occluder."""


@dataclass(frozen=True)
class Reach:
    """Which occluders a probe knows, by their distance in world units: from ``nearest`` on and nearer than ``tau``."""

    nearest: float = 0.0
    tau: float = torch.inf

    @classmethod
    def of(cls, variant: Variant, extent: float) -> "Reach":
        """That of a variant; ``extent``: the scene's, world units."""
        return cls(variant.nearest * extent, torch.inf if variant.tau is None else variant.tau * extent)

    def hidden(
        self, tracer: SurfelTracer, origin: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"]
    ) -> Bool[Tensor, " rays"]:
        """Whether each ray is more than half covered and the mean depth of what covers it is less than tau.

        Surfels are met from both sides: a probe may lie on either of them. The depth is that of the whole ray, divided
        by its opacity, as a rasterizer blends it.
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
    """The harmonics of M at every corner near a surfel; the other corners inherit the nearest probe, by grid steps.

    M(w) = 0 where ``Reach.hidden``, else 1, along ``directions`` directions that are spread over the sphere. There has
    to be at least one surfel.
    """
    near = corners_near(surfels, lattice)
    tracer = SurfelTracer(surfels).built()
    direction = sphere_directions(directions, dtype=lattice.low.dtype, device=lattice.low.device)
    onto = projection(direction)
    parts = []
    for some in lattice.places(near).split(max(1, RAYS_AT_ONCE // directions)):
        hidden = reach.hidden(tracer, some.repeat_interleave(directions, 0), direction.repeat(len(some), 1))
        parts.append((~hidden).to(onto).view(len(some), directions) @ onto)
    return OcclusionVolume(lattice, inherited(near, lattice.corners), torch.cat(parts))


def corners_near(surfels: Surfels, lattice: Lattice) -> Int[Tensor, " near"]:
    """Numbers, in order, of the corners of the cells that a surfel touches or is read in.

    That is at its centre and one standard deviation along each of its axes, and half a cell in front of these places.
    """
    along = (
        surfels.frame.detach() * torch.nn.functional.pad(surfels.scale.detach(), (0, 1), value=lattice.half)[:, None]
    )
    tangent_u, tangent_v, ahead = along.unbind(-1)
    on = [surfels.centre.detach() + offset for offset in (0 * ahead, tangent_u, -tangent_u, tangent_v, -tangent_v)]
    number, _ = lattice.around(torch.cat([*on, *(place + ahead for place in on)]))
    return torch.unique(number)


def inherited(near: Int[Tensor, " near"], corners: int) -> Int[Tensor, " corners"]:
    """The probe that each corner reads: its own place in ``near``, or that of a neighbour which has one by now.

    In rounds, by the six neighbours, so that a corner inherits from one of those that are fewest steps away.
    """
    probe = torch.full((corners,) * 3, -1, dtype=torch.int64, device=near.device)
    probe.view(-1)[near] = torch.arange(len(near), device=near.device)
    while bool((probe < 0).any()):
        before = probe.clone()
        for axis in range(3):
            _inherit(probe.narrow(axis, 0, corners - 1), before.narrow(axis, 1, corners - 1))
            _inherit(probe.narrow(axis, 1, corners - 1), before.narrow(axis, 0, corners - 1))
    return probe.flatten()


def _inherit(own: Tensor, neighbour: Tensor) -> None:
    own.copy_(torch.where(own < 0, neighbour, own))
