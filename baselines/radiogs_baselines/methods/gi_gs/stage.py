"""Stage 2 of GI-GS: materials and light from images of whole frames, shaded with what each frame shows of itself."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.backward import backward
from radiogs_core.learning.fit_geometry import surfels_of
from radiogs_core.learning.losses import environment_smoothness
from radiogs_core.learning.views import TrainingView, chosen_views, load, view_at
from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.transport.splitsum import PrefilteredLight

from ..split_sum import SplitSumLight
from .gbuffer import GBuffer, gbuffer, seen_materials
from .grid import Grid
from .losses import image_loss, plainness, variation
from .marching import March
from .model import Model
from .shading import Shader
from .start import frozen, rates_of, start_of


class InverseRendering:
    """Stage 2. Keeps geometry and radiance of stage 1, starts materials and light afresh. A ``contract.Stage``."""

    name = "invert"

    def __init__(self, run: Run, before: Mapping[str, Any]) -> None:
        variant, budget, device, scene = run.variant, run.budget, run.device, run.scene
        self.variant, self.seed = variant, run.seed
        self.iteration, self.iterations = 0, budget.inverse_iterations
        self.views = load(chosen_views(scene, variant.view_share, run.seed), device)
        generator = torch.Generator(device).manual_seed(run.seed)
        start = start_of(surfels_of(before, device), variant, budget.light_height, self.views, generator)
        self.optimiser = SurfelOptimiser(start.surfels, start.further, rates_of(variant, scene.extent))
        grid = Grid.of(budget.azimuths, budget.heights)
        march = March.of(grid, variant, budget.march_steps, scene.extent, variant.training_start)
        self.shader = Shader(march, variant.occlusion, variant.indirect, variant.sum, variant.straight)

    @property
    def model(self) -> Model:
        """What is learnt so far."""
        tensors = self.optimiser.tensors
        surfels = frozen(self.optimiser.surfels, self.variant.lr_scale > 0)
        return Model(surfels, tensors["log_environment"], tensors.get("metallic_logit"))

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name."""
        self.optimiser.set_rate("albedo_logit", self._albedo_rate())
        losses = self.losses(view_at(self.views, self.iteration, self.seed))
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.optimiser.step()
        self.iteration += 1
        return values

    def _albedo_rate(self) -> float:
        rates, progress = self.variant.materials.rates, self.iteration / self.iterations
        return rates.albedo ** (1 - progress) * rates.albedo_end**progress

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step by name, if it looks at ``view``."""
        model, weights = self.model, self.variant.materials.weights
        seen = seen_materials(view.camera, model.surfels, model.surfels.albedo, model.metallic)
        buffer, target = gbuffer(view.camera, seen), view.over(0.0)
        image = self.shader.shade(buffer, seen.alpha, SplitSumLight(PrefilteredLight(model.environment)))["image"]
        solid = torch.isfinite(buffer.depth)
        return {
            "shaded": weights.shaded * image_loss(image, target),
            "variation": weights.variation * variation(self._materials(buffer), target, solid),
            "plainness": weights.plainness * plainness(buffer, self.variant.metallic),
            "light smoothness": weights.light_smoothness * environment_smoothness(model.environment),
        }

    def _materials(self, buffer: GBuffer) -> Tensor:
        """Albedo, roughness and, where it is learnt, metallic, as one image."""
        metal = (buffer.metallic[:, None],) if self.variant.metallic else ()
        return buffer.image(torch.cat([buffer.albedo, buffer.roughness[:, None], *metal], -1))

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit; nothing is drawn at random after the start."""
        return {"iteration": self.iteration, "optimiser": self.optimiser.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.optimiser.restore(state["optimiser"])

    def product(self) -> dict[str, Any]:
        """The model as plain tensors (see ``Model.tensors``)."""
        return self.model.tensors()
