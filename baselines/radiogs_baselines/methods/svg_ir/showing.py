"""Rendering of a trained SVG-IR model from its table, under the recovered light and relit; labels of a run."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Prepared, Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.on_surfels.trained import ARRIVING, SHOWN_WITH_INCIDENT, Shown, TrainedOnSurfels, reduced
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.maps import mean_incident
from radiogs_core.transport.splatting import splat, towards, unit_or_zero

from .model import Model
from .settings import PRESETS, Budget, Variant
from .shading import Materials, bounced, downsampled, materials_of, shade_vertices
from .table import Table, Walk, table_of
from .vertices import blend_vertices


@dataclass(frozen=True)
class Lit:
    """The light of a rendering: an environment map and the table of incident light."""

    environment: Float[Tensor, "rows columns 3"]
    """Linear radiance of the distant light, after its upper limit."""
    table: Table
    """Visibility and indirect radiance of every surfel."""
    factor: Float[Tensor, ""] | float
    """Factor on the table's radiance."""


class TrainedSVGIR(TrainedOnSurfels[Model, Variant, Budget]):
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run[Variant, Budget]) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))
        self.walk = Walk.of(run.variant, run.scene.extent)

    def facts(self) -> dict[str, Any]:
        """Adds ``ratio``, the factor on the table's radiance, to the facts of ``TrainedOnSurfels``."""
        return super().facts() | {"ratio": float(self.model.ratio)}

    @property
    def surfels(self) -> Surfels:
        """The surfels, each with the mean material of its vertices."""
        return self.model.averaged()

    def as_trained(self) -> Prepared:
        """Rendering under the recovered light, shaded from the table of training."""
        variant, model = self.run.variant, self.model
        table = table_of(model.cached, self.walk, self.run.budget.incident_samples, self.run.seed)
        factor = model.ratio if variant.indirect else 0.0
        own = Lit(model.environment.clamp(0, variant.light_limit), table, factor)
        return Shown(self._renderer(model.albedo, own), SHOWN_WITH_INCIDENT)

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """Rendering under ``light`` with a new table, whose radiance is one bounce at the first hits."""
        variant, model = self.run.variant, self.model
        albedo = model.albedo * albedo_scale
        environment = downsampled(light, variant.relight_rows).radiance.clamp(0, variant.light_limit)
        table = table_of(model.surfels, self.walk, self.run.budget.relight_samples, self.run.seed)
        if variant.relight_indirect:
            materials = materials_of(model, albedo)
            table = table.with_radiance(bounced(materials, table, environment, variant.vertex_distance))
        return Shown(self._renderer(albedo, Lit(environment, table, float(variant.relight_indirect))))

    def _renderer(self, albedo: Tensor, lit: Lit) -> "Renderer":
        materials, variant = materials_of(self.model, albedo), self.run.variant
        return Renderer(self.model, materials, lit, variant.vertex_distance, variant.straight)


class Renderer:
    """Renders a model with the materials of its vertices (``shading.materials_of``) under one light.

    ``distance``: of the vertices from the surfel's axes, in standard deviations. ``straight``: see
    ``display.displayed``.
    """

    def __init__(self, model: Model, materials: Materials, lit: Lit, distance: float, straight: bool = True) -> None:
        self.model, self.materials, self.lit = model, materials.detach(), lit
        self.distance, self.straight = distance, straight

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps of one view (see ``on_surfels.trained.Renderer``); ``normal`` has the blended vertex normals."""
        surfels = self.model.surfels
        camera = camera.to(surfels.centre.device, surfels.centre.dtype)
        seen = splat(camera, surfels, {}, depth_unit=1.0)
        projection = surfels.seen_by(camera, radiance=False)
        arriving = () if set(ARRIVING).isdisjoint(further) else ARRIVING
        shaded = self._shaded(camera, torch.nonzero(projection.lists.touched)[:, 0], bool(arriving))
        blended = blend_vertices(projection, surfels, torch.cat([self.materials, shaded], -1), self.distance)
        albedo, roughness, normal, direct, indirect, *means = blended.split([3, 1, 3, 3, 3, *(3 for _ in arriving)], -1)
        return {
            "image": displayed(direct + indirect, seen.alpha, self.straight).clamp(0, 1),
            "direct": direct,
            "indirect": indirect,
            **dict(zip(arriving, means, strict=True)),
            "albedo": albedo,
            "roughness": roughness,
            "alpha": seen.alpha[..., None],
            "normal": unit_or_zero(normal),
            "depth": seen.depth[..., None],
        }

    def _shaded(self, camera: Camera, index: Tensor, arriving: bool) -> Float[Tensor, "surfels vertices channels"]:
        """Direct and indirect radiance of the vertices of the surfels ``index``, then the mean incident radiance,
        indirect and direct, if ``arriving``; zero for all others."""
        incident = self.lit.table.incident(index, self.lit.factor)
        outgoing = towards(camera, self.model.surfels)[index]
        direct, indirect = shade_vertices(self.materials[index], incident, outgoing, self.lit.environment)
        means = mean_incident(incident, self.lit.environment) if arriving else ()
        shaded = torch.cat([direct, indirect, *(each[:, None].expand_as(direct) for each in means)], -1)
        return shaded.new_zeros(*self.materials.shape[:2], shaded.shape[-1]).index_copy(0, index, shaded)


PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Differences from the published method, by name. ``extent``: the scene's extent, world units."""
    labels = {
        "geometry": "surfels of this project in place of flattened 3D Gaussians; no monocular normals",
        "stage1": "shared: novel-view synthesis in place of SVG-IR's own",
        "light_start": "shared: the light of least albedo variation (published: constant)"
        if variant.materials.start.light == "least-variation"
        else "constant, by the images' exposure",
        "hop": "rays of full length (published: 0.2 from hit to hit)"
        if variant.hop is None
        else f"{variant.hop * extent:.3g} world units (published: 0.2)",
        "ray_start": "one standard deviation of the surfel that a ray leaves (published: 0.042)"
        if variant.ray_start is None
        else f"{variant.ray_start * extent:.3g} world units (published: 0.042)",
        "attributes": f"vertices {variant.vertex_distance:g} standard deviations from the axes (published: by the size "
        "of the splat in the image)",
    }
    if variant.attributes == "constant":
        labels["attributes"] = "constant-attribute: one material a surfel in place of four vertices"
    fewer = reduced(budget, PAPER, "inverse_iterations", "incident_samples", "relight_samples")
    if budget.consistency_surfels < budget.geometry.maximum_surfels:
        surfels = f"consistency_surfels {budget.consistency_surfels} (published: all)"
        fewer = {"reduced": ", ".join([surfels, *fewer.values()])}
    return labels | fewer
