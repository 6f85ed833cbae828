"""Stage 2 of SVG-IR: materials and light, fitted to images and to the radiance of a table that is traced once."""

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.image.edges import edge_aware_smoothness
from radiogs_core.learning.losses import edge_weights, environment_smoothness, normal_consistency, reconstruction
from radiogs_core.learning.views import TrainingView
from radiogs_core.on_surfels.fit_geometry import surfels_of
from radiogs_core.on_surfels.light_start import SharedRays, starting_light_and_albedo
from radiogs_core.on_surfels.stage import SurfelStage
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import Surfels, roughness_to_logit
from radiogs_core.transport.splatting import Splat, own_radiance, splat, towards

from .model import LEARNT, Model
from .settings import Budget, MaterialRates, Variant
from .shading import materials_of, mirrored, one_bounce, shade_vertices
from .table import Table, Walk, table_of
from .vertices import blend_vertices


class InverseRendering(SurfelStage[Variant, Budget]):
    """Stage 2: keeps the geometry of stage 1 and learns new materials and light. A ``contract.Stage``.

    A resumed stage traces the table again from stage 1's surfels.
    """

    def __init__(self, run: Run[Variant, Budget], before: Mapping[str, Any]) -> None:
        variant, budget = run.variant, run.budget
        super().__init__(run, budget.inverse_iterations, variant.view_share)
        learnt = surfels_of(before, run.device)
        start = start_of(learnt, variant, budget.light_height, self.views, self.generator)
        self.cached = start.cached
        self.table = table_of(learnt, Walk.of(variant, run.scene.extent), budget.incident_samples, run.seed)
        further = {name: getattr(start, name) for name in LEARNT}
        self.optimiser = SurfelOptimiser(learnt, further, rates_of(variant.materials.rates))

    @property
    def model(self) -> Model:
        """The model at the current iteration."""
        learnt = {name: self.optimiser.tensors[name] for name in LEARNT}
        return Model(self.optimiser.surfels.detached(*FROZEN), self.cached, **learnt)

    def begin_step(self) -> None:
        """Freeze the ratio after ``ratio_until`` of the stage."""
        if self.iteration >= self.variant.materials.ratio_until * self.iterations:
            self.optimiser.set_rate("ratio", 0.0)

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """Weighted losses of a step on ``view``, by name; draws surfels from the generator."""
        model, weights = self.model, self.variant.materials.weights
        own = own_radiance(view.camera, model.surfels)
        seen = splat(view.camera, model.surfels, {"radiance": own}, self.depth_unit)
        shaded, materials = self._vertex_images(model, view)
        return {
            "shaded": weights.shaded * self._image_loss(shaded, seen, view),
            "radiance": weights.radiance * self._image_loss(seen.images["radiance"], seen, view),
            **self._map_losses(materials, seen, view),
            "offset": weights.offset * model.vertex_offset.square().mean(),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
            **self._consistency(model, view),
        }

    def _vertex_images(self, model: Model, view: TrainingView) -> tuple[Tensor, Tensor]:
        """Blended images of linear shaded radiance [height, width, 3], and of albedo, roughness and normal [..., 7]."""
        surfels, camera = model.surfels, view.camera.to(model.cached.centre.device, model.cached.centre.dtype)
        seen = surfels.seen_by(camera, radiance=False)
        index = torch.nonzero(seen.lists.touched)[:, 0]
        materials = materials_of(model, model.albedo)
        arriving = self.table.incident(index, model.ratio if self.variant.indirect else 0.0)
        light = model.environment.clamp(0, self.variant.light_limit)
        outgoing = towards(camera, surfels)[index]
        direct, indirect = shade_vertices(materials.index_select(0, index), arriving, outgoing, light)
        radiance = torch.zeros_like(model.vertex_offset).index_copy(0, index, direct + indirect)
        images = blend_vertices(seen, surfels, torch.cat([radiance, materials], -1), self.variant.vertex_distance)
        return images[..., :3], images[..., 3:]

    def _image_loss(self, radiance: Tensor, seen: Splat, view: TrainingView) -> Tensor:
        weights = self.variant.materials.weights
        found = displayed(radiance, seen.alpha, self.variant.straight)
        return reconstruction(view.where_valid(found), view.over(0.0), weights.absolute, weights.similarity)

    def _map_losses(self, materials: Tensor, seen: Splat, view: TrainingView) -> dict[str, Tensor]:
        """Losses of the smoothness of material maps, and of vertex normals against the depth map."""
        weights, geometry = self.variant.materials.weights, self.variant.geometry
        albedo, roughness, normal = materials.split([3, 1, 3], -1)
        allowance = edge_weights(view, geometry.edge_sharpness, geometry.across_silhouettes)
        mask = view.mask[..., None]
        target = seen.depth_normal(view.camera, geometry.normal_target == "one-sided")
        return {
            "albedo smoothness": weights.albedo_smoothness * edge_aware_smoothness(mask * albedo, allowance),
            "roughness smoothness": weights.roughness_smoothness * edge_aware_smoothness(mask * roughness, allowance),
            "normal": weights.normal * normal_consistency(normal, seen.alpha, target),
        }

    def _consistency(self, model: Model, view: TrainingView) -> dict[str, Tensor]:
        weight = self.variant.materials.weights.consistency
        if weight == 0:
            return {}
        order = torch.randperm(len(model.surfels), generator=self.generator, device=model.vertex_offset.device)
        light = model.environment.clamp(0, self.variant.light_limit)
        index, distance = order[: self.budget.consistency_surfels], self.variant.vertex_distance
        return {"consistency": weight * radiance_consistency(
            model, self.table, index, view.camera.centre, light, distance
        )}  # fmt: skip


def radiance_consistency(
    model: Model,
    table: Table,
    index: Int[Tensor, " chosen"],
    eye: Float[Tensor, "3"],
    environment: Float[Tensor, "rows columns 3"],
    distance: float,
) -> Float[Tensor, ""]:
    """Mean L1, over the surfels ``index``, between one-bounce radiance and the table's radiance times the ratio.

    Each surfel contributes the ray of ``mirrored``, or zero without one. Gradient to the materials of the hit surfels,
    whether or not a camera sees them, to ``environment`` (linear) and to the ratio.
    """
    surfel, sample = mirrored(table, model.surfels, index, eye)
    if not len(surfel):
        return environment.new_zeros(())
    bounce = one_bounce(materials_of(model, model.albedo), table, surfel, sample, environment, distance)
    traced = model.ratio * table.radiance[surfel, sample]
    return (bounce - traced).abs().sum() / (3 * len(index))


FROZEN = ("centre", "rotation", "log_scale", "albedo_logit", "roughness_logit")
"""Raw parameters of surfels that stage 2 does not learn: position and shape, and materials, which vertices have."""


def start_of(
    learnt: Surfels, variant: Variant, rows: int, views: tuple[TrainingView, ...], generator: torch.Generator
) -> Model:
    """The surfels of stage 1 with initial materials, and an initial light of ``rows`` rows."""
    start, vertices, like = variant.materials.start, variant.vertices, learnt.centre
    light, albedo, _ = starting_light_and_albedo(SharedRays(learnt), views, rows, start, generator)
    return Model(
        surfels=learnt,
        cached=learnt,
        vertex_albedo_logit=torch.logit(albedo)[:, None].repeat(1, vertices, 1),
        vertex_roughness_logit=like.new_full((len(learnt), vertices), roughness_to_logit(start.roughness)),
        vertex_offset=like.new_zeros(len(learnt), vertices, 3),
        log_environment=light.log(),
        ratio=like.new_ones(()),
    )


def rates_of(rates: MaterialRates) -> dict[str, float]:
    """Learning rates by raw parameter."""
    return dict.fromkeys(FROZEN, 0.0) | {
        "opacity_logit": rates.opacity,
        "sh": rates.radiance,
        "sh_rest": rates.radiance_rest,
        "vertex_albedo_logit": rates.albedo,
        "vertex_roughness_logit": rates.roughness,
        "vertex_offset": rates.offset,
        "log_environment": rates.light,
        "ratio": rates.ratio,
    }
