"""A trained SVG-IR model as the harness shows it: under the light that it has recovered, and relit."""

from typing import Any

from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Prepared, Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

from ..trained_on_surfels import Shown, TrainedOnSurfels
from .labels import labels_of
from .model import Model
from .rendering import Lit, Renderer
from .shading import bounced, limited, materials_of, reduced
from .table import Walk, table_of


class TrainedSVGIR(TrainedOnSurfels[Model]):
    """Surfels with vertices and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))
        self.walk = Walk.of(run.variant, run.scene.extent)

    def facts(self) -> dict[str, Any]:
        """``ratio``: the factor on kept radiance. The rest: see ``TrainedOnSurfels``."""
        return super().facts() | {"ratio": float(self.model.ratio)}

    @property
    def surfels(self) -> Surfels:
        """Each surfel with the mean material of its vertices."""
        return self.model.averaged()

    def as_trained(self) -> Prepared:
        """Shaded from the table of training."""
        variant, model = self.run.variant, self.model
        table = table_of(model.cached, self.walk, self.run.budget.incident_samples, self.run.seed)
        factor = model.ratio if variant.indirect else 0.0
        own = Lit(limited(model.environment, variant.light_limit), table, factor)
        return self._shown(model.albedo, own, incident=True)

    def relit(self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"]) -> Prepared:
        """With a new table, whose radiance is one bounce at the first hits."""
        variant, model = self.run.variant, self.model
        albedo = model.albedo * albedo_scale
        environment = limited(reduced(light, variant.relight_rows).radiance, variant.light_limit)
        table = table_of(model.surfels, self.walk, self.run.budget.relight_samples, self.run.seed)
        if variant.relight_indirect:
            materials = materials_of(model, albedo)
            table = table.with_radiance(bounced(materials, table, environment, variant.vertex_distance))
        return self._shown(albedo, Lit(environment, table, float(variant.relight_indirect)), incident=False)

    def _shown(self, albedo: Tensor, lit: Lit, incident: bool) -> Shown:
        materials, variant = materials_of(self.model, albedo), self.run.variant
        return Shown(Renderer(self.model, materials, lit, variant.vertex_distance, variant.straight), incident)
