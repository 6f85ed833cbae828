"""Rendering of a trained IRGS model, under the recovered light and relit.

Rays are traced from every covered pixel. Labels state how a run differs from the published method.
"""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Prepared, Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.on_surfels.seen_points import SeenPoints, covered_pixels, seen_points, seen_surfels
from radiogs_core.on_surfels.trained import (
    ARRIVING,
    SHOWN_WITH_INCIDENT,
    Shown,
    TrainedOnSurfels,
    blended_maps,
    light_start,
    reduced,
)
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.hit_surface import hit_features
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import mean_incident
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.splatting import Splat
from radiogs_core.transport.splitsum import PrefilteredLight
from radiogs_core.transport.tracer import RAYS_AT_ONCE, SurfelTracer

from ..labels import length
from .rays import RaySettings, shade_points
from .settings import PRESETS, Budget, Indirect, Variant


class TrainedIRGS(TrainedOnSurfels[LitSurfels, Variant, Budget]):
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: LitSurfels, run: Run[Variant, Budget]) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))
        self.rays = RaySettings.of(run.variant, run.scene.extent)

    def as_trained(self) -> Prepared:
        """Rendering under the recovered light; rays are traced for each image."""
        variant, surfels = self.run.variant, self.model.surfels
        own = RecoveredLight(self.model, self.rays, self.run.budget.render_samples, variant.indirect)
        return Shown(Renderer(surfels, surfels.albedo, own, self.run.seed, variant.straight), SHOWN_WITH_INCIDENT)

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """Rendering under ``light``; rays are traced for each image, and their hits are shaded by the split sum."""
        variant, budget, surfels = self.run.variant, self.run.budget, self.model.surfels
        recovered = surfels.albedo.detach()
        scaled = recovered * albedo_scale
        new = NewLight(
            surfels,
            scaled if variant.secondary_albedo == "scaled" else recovered,
            light,
            self.rays,
            (budget.relight_hemisphere_samples, budget.relight_light_samples),
            variant.relight_indirect,
        )
        return Shown(Renderer(surfels, scaled, new, self.run.seed, variant.straight))


class RecoveredLight:
    """The recovered light, with indirect light as in training (``Variant.indirect``).

    Every point has the same directions in its tangent frame.
    """

    def __init__(self, model: LitSurfels, rays: RaySettings, samples: int, indirect: Indirect) -> None:
        self.environment, self.samples = model.environment, samples
        self.rays, self.indirect, self.tracer = rays, indirect, SurfelTracer(model.surfels).built()

    def on(self, points: SeenPoints, generator: torch.Generator) -> Incident:
        """V and L_ind along directions spread evenly over the hemisphere."""
        direction, weight = hemisphere_directions(points.normal, self.samples, None)
        return self.rays.incident(self.tracer, points, direction, weight, self.indirect)


class NewLight:
    """A new light, sampled over the hemisphere and in proportion to its radiance; L_ind is the split sum at hits.

    Args:
        surfels: Surfels that rays are traced through.
        hit_albedo: Linear albedo of the surfels that rays hit.
        light: The new light.
        rays: How rays are traced.
        samples: Numbers of rays over the hemisphere and from the light.
        indirect: Whether there is indirect light.

    Raises:
        DataError: The light is not finite.
    """

    def __init__(
        self,
        surfels: Surfels,
        hit_albedo: Float[Tensor, "surfels 3"],
        light: EnvironmentMap,
        rays: RaySettings,
        samples: tuple[int, int],
        indirect: bool,
    ) -> None:
        self.environment, self.samples, self.of_each = light.radiance, sum(samples), samples
        self.rays, self.indirect, self.tracer = rays, indirect, SurfelTracer(surfels).built()
        self.sampler, self.prefiltered = LightSampler(light), PrefilteredLight(light.radiance)
        self.features = hit_features(surfels, hit_albedo)

    def on(self, points: SeenPoints, generator: torch.Generator) -> Incident:
        """V along the sampled directions, and L_ind unless indirect light is off."""
        direction, weight = relighting_directions(points.normal, self.sampler, *self.of_each, generator)
        if not self.indirect:
            return self.rays.incident(self.tracer, points, direction, weight, "none")
        return self.rays.relit(self.tracer, points, direction, weight, self.features, self.prefiltered)


class Renderer:
    """Renders surfels under a light; ``albedo`` (linear) is the albedo of the visible surfels.

    The image of a camera does not depend on earlier images: directions are drawn from ``seed`` for each image.
    """

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        light: RecoveredLight | NewLight,
        seed: int,
        straight: bool = True,
    ) -> None:
        self.surfels, self.albedo, self.light, self.seed, self.straight = surfels, albedo, light, seed, straight

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps of one view; see ``on_surfels.trained.Renderer``."""
        seen = seen_surfels(camera, self.surfels, self.albedo, {})
        radiance = self._radiance(camera, seen, () if set(ARRIVING).isdisjoint(further) else ARRIVING)
        return {
            **radiance,
            "image": displayed(radiance["direct"] + radiance["indirect"], seen.alpha, self.straight).clamp(0, 1),
            **blended_maps(seen),
        }

    def _radiance(self, camera: Camera, seen: Splat, arriving: tuple[str, ...]) -> Maps:
        """Maps ``direct``, ``indirect`` and ``arriving`` (all of ``ARRIVING`` or none), shaded in batches of at most
        ``RAYS_AT_ONCE`` rays."""
        generator = torch.Generator(seen.alpha.device).manual_seed(self.seed)
        names = ("direct", "indirect", *arriving)
        maps = {name: torch.zeros(seen.alpha.numel(), 3, device=seen.alpha.device) for name in names}
        for pixels in covered_pixels(seen).split(max(1, RAYS_AT_ONCE // self.light.samples)):
            points = seen_points(camera, seen, pixels)
            incident = self.light.on(points, generator)
            shaded = shade_points(points, incident, self.light.environment)
            alpha = seen.alpha.flatten()[pixels, None]
            means = mean_incident(incident, self.light.environment) if arriving else ()
            for name, values in zip(names, (shaded.direct, shaded.indirect, *means), strict=True):
                maps[name][pixels] = alpha * values
        return {name: values.view(*seen.alpha.shape, 3) for name, values in maps.items()}


PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Differences from the published method, by name. ``extent``: the scene's extent, world units."""
    labels = {
        "geometry": "surfels of this project, traced and rasterised by its kernels",
        "stage1": "shared: novel-view synthesis in place of Ref-Gaussian",
        "light_start": light_start(variant.materials.start.light, "a constant 1.5"),
        "ray_start": length(
            variant.ray_start, extent, "0.05", "one standard deviation of the surfels that a pixel sees"
        ),
        "fresnel": "F0 0.04 also at the hits of relit rays (published: 0.02)",
        "masking": "Schlick's in the split sum at the hits of relit rays (published table: height-correlated)",
    }
    labels |= reduced(
        budget, PAPER, "inverse_iterations", "pixels", "incident_samples", "relight_hemisphere_samples",
        "relight_light_samples", "render_samples",
    )  # fmt: skip
    if variant.lr_scale > 0:
        labels["lr_scale"] = f"{variant.lr_scale:g} (published scripts: 0)"
    return labels
