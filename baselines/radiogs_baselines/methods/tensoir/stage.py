"""The stages of TensoIR: a radiance field from the training images, then its materials and the light beside it."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.backward import backward
from radiogs_core.learning.views import chosen_views, load

from .box import Box, box_of
from .drawing import Drawn, drawn_rays
from .field import Field, field_start
from .inverse_losses import inverse_losses
from .light import SphericalGaussians, light_start
from .losses import on_background, sparsity, squared_error, variation
from .marching import march
from .model import LIGHT, Model
from .optimiser import Optimiser


class _Learning:
    """What both stages share: views, rays, an optimiser of everything that is learnt, and resuming."""

    name = ""
    iterations = 0
    random_background = False

    def __init__(self, run: Run) -> None:
        self.variant, self.budget, self.seed = run.variant, run.budget, run.seed
        self.iteration = 0
        self.views = load(chosen_views(run.scene, run.variant.view_share, run.seed), run.device)
        self.generator = torch.Generator(run.device).manual_seed(run.seed)

    def begin(self, box: Box, parameters: Mapping[str, Tensor]) -> None:
        """Learn these from now on."""
        total = self.budget.field_iterations + self.budget.inverse_iterations
        self.box = box
        self.optimiser = Optimiser(parameters, self.variant.learning.rates, self.budget.network_rate, total)

    @property
    def field(self) -> Field:
        """What is learnt so far, with gradients."""
        return Field(self.box, {name: value for name, value in self.optimiser.tensors.items() if name != LIGHT})

    def drawn(self) -> Drawn:
        """The rays of the next step."""
        order = (self.iteration, self.seed)
        return drawn_rays(self.views, self.box, self.budget, order, self.generator, self.random_background)

    def losses(self, drawn: Drawn) -> dict[str, Tensor]:
        """The weighted losses of some rays by name."""
        raise NotImplementedError

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name."""
        losses = self.losses(self.drawn())
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.optimiser.step()
        self.iteration += 1
        return values

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        return {
            "iteration": self.iteration,
            "box": self.box.tensors(),
            "optimiser": self.optimiser.state(),
            "generator": self.generator.get_state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.box = Box.of(state["box"], self.box.centre.device)
        self.optimiser.restore(state["optimiser"])
        self.generator.set_state(state["generator"])


class RadianceField(_Learning):
    """Stage 1: density and radiance by novel-view synthesis alone. A ``contract.Stage``."""

    name = "field"

    def __init__(self, run: Run, before: Mapping[str, Any]) -> None:
        super().__init__(run)
        self.iterations = self.budget.field_iterations
        start = field_start(box_of(run.scene, self.views, self.budget.cells), self.budget, self.generator)
        self.begin(start.box, start.parameters)

    def losses(self, drawn: Drawn) -> dict[str, Tensor]:
        """Radiance is taken for display values, unless it is linear from the start."""
        weights, field = self.variant.learning.radiance_field, self.field
        marched = march(field, drawn.rays, self.generator)
        radiance = field.radiance(field.features(marched.places), drawn.rays.direction[marched.ray])
        blended, linear = marched.blended(radiance), self.variant.linear == "from-start"
        found = on_background(blended, marched.alpha, drawn.background, linear)
        return {
            "radiance": weights.radiance * squared_error(found, drawn.target),
            "sparsity": weights.sparsity * sparsity(field),
            "density variation": weights.density_variation * variation(field.parameters["density_plane"]),
            "appearance variation": weights.appearance_variation * variation(field.parameters["appearance_plane"]),
        }

    def product(self) -> dict[str, Any]:
        """The box, and the field's parameters."""
        return {"box": self.box.tensors(), "parameters": self.optimiser.plain()}


class InverseRendering(_Learning):
    """Stage 2: linear radiance, normals, materials and light together, on finer and finer grids. A ``contract.Stage``.

    Keeps the field of stage 1; the light starts afresh.
    """

    name = "invert"

    def __init__(self, run: Run, before: Mapping[str, Any]) -> None:
        super().__init__(run)
        self.iterations = self.budget.inverse_iterations
        self.random_background = self.variant.background == "random-later"
        parameters = {name: value.to(run.device) for name, value in before["parameters"].items()}
        light = light_start(self.budget.lobes, self.variant.learning.light, self.generator)
        self.begin(Box.of(before["box"], run.device), {**parameters, LIGHT: light})

    @property
    def model(self) -> Model:
        """What is learnt so far."""
        return Model(self.field, SphericalGaussians(self.optimiser.tensors[LIGHT]))

    def step(self) -> Mapping[str, float]:
        """As of ``_Learning``, after what the schedule has for this step."""
        self._follow_schedule()
        return super().step()

    def _follow_schedule(self) -> None:
        schedule = self.variant.learning.schedule
        for place, share in enumerate(schedule.finer_at):
            if round(share * self.iterations) == self.iteration:
                finer = self.field.finer(self.grid_size(place + 1))
                self.optimiser.replace({**finer.parameters, LIGHT: self.optimiser.tensors[LIGHT]})
        if self.iteration in {round(share * self.iterations) for share in schedule.emptied_at}:
            self.box = self.field.emptied().box

    def grid_size(self, times: int) -> int:
        """Nodes of the grid along an edge when it has become finer so many times."""
        first, last, of = self.budget.grid_start, self.budget.grid_end, len(self.variant.learning.schedule.finer_at)
        return round(first * (last / first) ** (times / of))

    def losses(self, drawn: Drawn) -> dict[str, Tensor]:
        """See ``inverse_losses``."""
        return inverse_losses(self.model, drawn, self.variant, self.budget, self.generator)

    def product(self) -> dict[str, Any]:
        """The model as plain values (see ``Model.tensors``)."""
        return self.model.tensors()
