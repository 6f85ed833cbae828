"""Stage 2 of R3DG: materials, light and local light from images of shaded surfels; geometry is frozen."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.backward import backward
from radiogs_core.learning.fit_geometry import surfels_of
from radiogs_core.learning.views import TrainingView, chosen_views, load, mean_distance, view_at
from radiogs_core.surfels.optimiser import SurfelOptimiser

from .local_light import arriving
from .losses import image_losses, light_losses
from .materials import bounded
from .model import Model
from .shading import blended, light_surfels
from .start import frozen, rates_of, start_of
from .visibility import Rays, VisibilityTable


class InverseRendering:
    """Stage 2. Keeps geometry and radiance of stage 1, starts materials and light afresh. A ``contract.Stage``."""

    name = "invert"

    def __init__(self, run: Run, before: Mapping[str, Any]) -> None:
        variant, budget, device, scene = run.variant, run.budget, run.device, run.scene
        self.variant, self.budget, self.seed = variant, budget, run.seed
        self.iteration, self.iterations = 0, budget.inverse_iterations
        self.views = load(chosen_views(scene, variant.view_share, run.seed), device)
        self.depth_unit = mean_distance(self.views, scene.centre)
        self.generator = torch.Generator(device).manual_seed(run.seed)
        learnt = surfels_of(before, device)
        start = start_of(learnt, variant, budget.light_height, self.views, self.generator)
        self.optimiser = SurfelOptimiser(start.surfels, start.further, rates_of(variant, budget))
        self.table = VisibilityTable(learnt, Rays.of(variant, scene.extent), budget.incident_samples)

    @property
    def retraces(self) -> bool:
        """Whether V is traced anew along the way."""
        return bool(self.variant.visibility == "retraced")

    @property
    def model(self) -> Model:
        """What is learnt so far."""
        tensors = self.optimiser.tensors
        local = torch.cat([tensors["local"], tensors["local_rest"]], 1)
        return Model(bounded(frozen(self.optimiser.surfels)), local, tensors["raw_environment"])

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name."""
        if self.retraces:
            order = torch.randperm(len(self.table.normal), generator=self.generator, device=self.table.normal.device)
            self.table.retrace(order[: self.budget.retraced_surfels], self.generator)
        losses = self.losses(view_at(self.views, self.iteration, self.seed))
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.optimiser.step()
        self.iteration += 1
        return values

    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step by name, if it looks at ``view``."""
        model, weights = self.model, self.variant.materials.weights
        incident = arriving(self.table, model.local, self.variant.local_light)
        lit = light_surfels(view.camera, model.surfels, incident, model.environment)
        seen = blended(view.camera, model.surfels, lit, self.depth_unit)
        images = image_losses(seen, view.over(0.0), view.mask, weights, self.variant.geometry)
        return images | light_losses(lit.irradiance, model.environment, weights)

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit. A table that is traced once is traced alike when resumed."""
        return {
            "iteration": self.iteration,
            "optimiser": self.optimiser.state(),
            "generator": self.generator.get_state(),
            "table": self.table.state() if self.retraces else {},
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.optimiser.restore(state["optimiser"])
        self.generator.set_state(state["generator"])
        if self.retraces:
            self.table.restore(state["table"])

    def product(self) -> dict[str, Any]:
        """The model as plain tensors (see ``Model.tensors``)."""
        return self.model.tensors()
