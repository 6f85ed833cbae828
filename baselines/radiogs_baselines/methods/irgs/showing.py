"""Rendering of a trained IRGS model by rays from every covered pixel, under the recovered light and relit; labels."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Prepared, Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.model import LitSurfels
from radiogs_core.on_surfels.seen_points import SeenPoints, covered_pixels, seen_points, seen_surfels
from radiogs_core.on_surfels.trained import ARRIVING, SHOWN_WITH_INCIDENT, Shown, TrainedOnSurfels, light_start, reduced
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.hit_surface import hit_features
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import blended_maps, mean_incident
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.sampling import hemisphere_directions, relighting_directions
from radiogs_core.transport.splatting import Splat
from radiogs_core.transport.tracer import RAYS_AT_ONCE, SurfelTracer

from .rays import RaySettings, shade_points
from .settings import PRESETS, Budget, Variant


class TrainedIRGS(TrainedOnSurfels[LitSurfels, Variant, Budget]):
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: LitSurfels, run: Run[Variant, Budget]) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))
        self.rays = RaySettings.of(run.variant, run.scene.extent)

    def as_trained(self) -> Prepared:
        """Rendering under the recovered light; rays are traced for each image, spread evenly over the hemisphere.

        Indirect light is as in training (``Variant.indirect``). Every point has the same directions in its frame.
        """
        variant, surfels, samples = self.run.variant, self.model.surfels, self.run.budget.render_samples
        tracer = SurfelTracer(surfels).built()

        def arriving(points: SeenPoints, generator: torch.Generator) -> Incident:
            direction, weight = hemisphere_directions(points.normal, samples, None)
            return self.rays.incident(tracer, points, direction, weight, variant.indirect)

        environment = self.model.environment
        own = Renderer(surfels, surfels.albedo, environment, samples, arriving, self.run.seed, variant.straight)
        return Shown(own, SHOWN_WITH_INCIDENT)

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """Rendering under ``light``; rays are traced for each image, and their hits are shaded by the split sum.

        Directions are spread over the hemisphere and sampled in proportion to the light.
        """
        variant, budget, surfels = self.run.variant, self.run.budget, self.model.surfels
        recovered = surfels.albedo.detach()
        scaled = recovered * albedo_scale
        samples = (budget.relight_hemisphere_samples, budget.relight_light_samples)
        tracer, sampler, filtered = SurfelTracer(surfels).built(), LightSampler(light), PrefilteredLight(light.radiance)
        features = hit_features(surfels, scaled if variant.secondary_albedo == "scaled" else recovered)

        def arriving(points: SeenPoints, generator: torch.Generator) -> Incident:
            direction, weight = relighting_directions(points.normal, sampler, *samples, generator)
            if not variant.relight_indirect:
                return self.rays.incident(tracer, points, direction, weight, "none")
            return self.rays.relit(tracer, points, direction, weight, features, filtered)

        return Shown(Renderer(surfels, scaled, light.radiance, sum(samples), arriving, self.run.seed, variant.straight))


@dataclass(frozen=True)
class Renderer:
    """Renders surfels under a light. The image of a camera does not depend on earlier images."""

    surfels: Surfels
    albedo: Float[Tensor, "surfels 3"]
    """Linear albedo of the visible surfels."""
    environment: Float[Tensor, "rows columns 3"]
    """Radiance of the distant light, linear."""
    samples: int
    """Rays from each point."""
    arriving: Callable[[SeenPoints, torch.Generator], Incident]
    """Gives the incident light of points: directions, visibility and indirect radiance."""
    seed: int
    """Seed of the directions of each image."""
    straight: bool
    """Order of display encoding and coverage (see ``display.displayed``)."""

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
        """Maps ``direct``, ``indirect`` and all or no ``ARRIVING``, in batches of at most ``RAYS_AT_ONCE`` rays."""
        generator = torch.Generator(seen.alpha.device).manual_seed(self.seed)
        names = ("direct", "indirect", *arriving)
        maps = {name: torch.zeros(seen.alpha.numel(), 3, device=seen.alpha.device) for name in names}
        for pixels in covered_pixels(seen).split(max(1, RAYS_AT_ONCE // self.samples)):
            points = seen_points(camera, seen, pixels)
            incident = self.arriving(points, generator)
            shaded = shade_points(points, incident, self.environment)
            alpha = seen.alpha.flatten()[pixels, None]
            means = mean_incident(incident, self.environment) if arriving else ()
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
        "ray_start": "one standard deviation of the surfels that a pixel sees (published: 0.05)"
        if variant.ray_start is None
        else f"{variant.ray_start * extent:.3g} world units (published: 0.05)",
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
