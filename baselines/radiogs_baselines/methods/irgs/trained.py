"""A trained IRGS model as the harness shows it: under the light that it has recovered, and relit."""

from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Prepared, Run
from radiogs_core.scene.light import EnvironmentMap

from ..trained_on_surfels import Shown, TrainedOnSurfels
from .labels import labels_of
from .model import Model
from .rays import Rays
from .rendering import NewLight, RecoveredLight, Renderer


class TrainedIRGS(TrainedOnSurfels[Model]):
    """Surfels with materials and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))
        self.rays = Rays.of(run.variant, run.scene.extent)

    def as_trained(self) -> Prepared:
        """Rays are traced for each image."""
        variant, surfels = self.run.variant, self.model.surfels
        own = RecoveredLight(self.model, self.rays, self.run.budget.render_samples, variant.indirect)
        return Shown(Renderer(surfels, surfels.albedo, own, self.run.seed, variant.straight), incident=True)

    def relit(self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"]) -> Prepared:
        """Rays are traced for each image; what they meet is shaded by the split sum."""
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
