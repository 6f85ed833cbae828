"""A trained GI-GS model as the harness shows it: under the light that it has recovered, and relit."""

from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Prepared, Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.splitsum import PrefilteredLight

from ..split_sum import SplitSumLight
from ..trained_on_surfels import Shown, TrainedOnSurfels
from .grid import Grid
from .labels import labels_of
from .marching import March
from .model import Model
from .rendering import Renderer
from .shading import Shader


class TrainedGIGS(TrainedOnSurfels[Model]):
    """Surfels with materials and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))

    def as_trained(self) -> Prepared:
        """Shaded as in training."""
        own = self._shader(self.run.variant.occlusion, self.run.variant.indirect)
        light = SplitSumLight(PrefilteredLight(self.model.environment.detach())).ready()
        return Shown(Renderer(self.model, self.model.surfels.albedo.detach(), light, own), incident=True)

    def relit(self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"]) -> Prepared:
        """Without occlusion, and with the bounce of the frame under the new light."""
        new = SplitSumLight(PrefilteredLight(light.radiance), self.run.variant.frame).ready()
        shader = self._shader(occlusion=False, indirect=self.run.variant.relight_indirect)
        return Shown(Renderer(self.model, self.model.surfels.albedo.detach() * albedo_scale, new, shader))

    def _shader(self, occlusion: bool, indirect: bool) -> Shader:
        variant, budget = self.run.variant, self.run.budget
        grid = Grid.of(budget.render_azimuths, budget.render_heights)
        march = March.of(grid, variant, budget.march_steps, self.run.scene.extent, variant.start)
        return Shader(march, occlusion, indirect, variant.sum, variant.straight)
