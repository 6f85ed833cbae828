"""The stages of TensoIR: a radiance field from the training images, then materials and light.

Both use Adam on named parameters whose shapes may change. Stage 2 compares marched and shaded pixels with the images
and regularises normals and materials.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.learning.backward import backward
from radiogs_core.learning.views import chosen_views, load
from radiogs_core.scene.colour import srgb_encode

from .box import Box, box_of
from .drawing import RayBatch, ray_batch
from .field import GRIDS, Field, field_start
from .light import SphericalGaussians, light_start
from .lighting import RecoveredLight
from .losses import facing_away, mean_along_rays, on_background, relative_difference, sparsity, squared_error, variation
from .marching import Rays, march
from .model import LIGHT, Model
from .settings import Budget, Rates, Variant
from .shading import SampleValues, sample_values, surface_points


class _Learning(ABC):
    """Base of both stages: training views, ray batches, the optimiser, and resuming."""

    name = ""
    iterations = 0
    random_background = False

    def __init__(self, run: Run) -> None:
        self.variant, self.budget, self.seed = run.variant, run.budget, run.seed
        self.iteration = 0
        self.views = load(chosen_views(run.scene, run.variant.view_share, run.seed), run.device)
        self.generator = torch.Generator(run.device).manual_seed(run.seed)

    def begin(self, box: Box, parameters: Mapping[str, Tensor]) -> None:
        """Start the optimiser on these parameters."""
        total = self.budget.field_iterations + self.budget.inverse_iterations
        self.box = box
        self.optimiser = Optimiser(parameters, self.variant.learning.rates, self.budget.network_rate, total)

    @property
    def field(self) -> Field:
        """The field at the current iteration, with gradients."""
        return Field(self.box, {name: value for name, value in self.optimiser.tensors.items() if name != LIGHT})

    def next_batch(self) -> RayBatch:
        """Draw the rays of the next step."""
        order = (self.iteration, self.seed)
        return ray_batch(self.views, self.box, self.budget, order, self.generator, self.random_background)

    @abstractmethod
    def losses(self, batch: RayBatch) -> dict[str, Tensor]:
        """Weighted losses of the rays, by name."""

    def step(self) -> Mapping[str, float]:
        """Do one optimisation step; returns the weighted losses by name."""
        losses = self.losses(self.next_batch())
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.optimiser.step()
        self.iteration += 1
        return values

    def state(self) -> dict[str, Any]:
        """All values needed to resume bit for bit."""
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
    """Stage 1: density and radiance by novel-view synthesis. A ``contract.Stage``."""

    name = "field"

    def __init__(self, run: Run, before: Mapping[str, Any]) -> None:
        super().__init__(run)
        self.iterations = self.budget.field_iterations
        start = field_start(box_of(run.scene, self.views, self.budget.cells), self.budget, self.generator)
        self.begin(start.box, start.parameters)

    def losses(self, batch: RayBatch) -> dict[str, Tensor]:
        """Weighted losses of the rays, by name; radiance is display values unless ``linear`` is "from-start"."""
        weights, field = self.variant.learning.radiance_field, self.field
        marched = march(field, batch.rays, self.generator)
        radiance = field.radiance(field.features(marched.positions), batch.rays.direction[marched.ray])
        blended, linear = marched.blended(radiance), self.variant.linear == "from-start"
        found = on_background(blended, marched.alpha, batch.background, linear)
        return {
            "radiance": weights.radiance * squared_error(found, batch.target),
            "sparsity": weights.sparsity * sparsity(field),
            "density variation": weights.density_variation * variation(field.parameters["density_plane"]),
            "appearance variation": weights.appearance_variation * variation(field.parameters["appearance_plane"]),
        }

    def product(self) -> dict[str, Any]:
        """The box and the field's parameters as plain values."""
        return {"box": self.box.tensors(), "parameters": self.optimiser.plain()}


class InverseRendering(_Learning):
    """Stage 2: linear radiance, normals, materials and light, on increasingly fine grids. A ``contract.Stage``.

    It continues the field of stage 1 with a new light.
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
        """The model at the current iteration."""
        return Model(self.field, SphericalGaussians(self.optimiser.tensors[LIGHT]))

    def step(self) -> Mapping[str, float]:
        """Apply this step's schedule, then do an optimisation step; returns the weighted losses by name."""
        self._follow_schedule()
        return super().step()

    def _follow_schedule(self) -> None:
        schedule, first = self.variant.learning.schedule, self.budget.grid_start
        growth = self.budget.grid_end / first
        for index, share in enumerate(schedule.finer_at):
            if round(share * self.iterations) == self.iteration:
                finer = self.field.finer(round(first * growth ** ((index + 1) / len(schedule.finer_at))))
                self.optimiser.replace({**finer.parameters, LIGHT: self.optimiser.tensors[LIGHT]})
        if self.iteration in {round(share * self.iterations) for share in schedule.emptied_at}:
            self.box = self.field.emptied().box

    def losses(self, batch: RayBatch) -> dict[str, Tensor]:
        """Weighted losses of the rays, by name; see ``inverse_losses``."""
        return inverse_losses(self.model, batch, self.variant, self.budget, self.generator)

    def product(self) -> dict[str, Any]:
        """The model as plain values (see ``Model.tensors``)."""
        return self.model.tensors()


def inverse_losses(
    model: Model, batch: RayBatch, variant: Variant, budget: Budget, generator: torch.Generator
) -> dict[str, Tensor]:
    """Weighted losses of the rays, by name; ``generator`` displaces samples, directions and nearby positions."""
    weights, field, rays = variant.learning.inverse, model.field, batch.rays
    marched = march(field, rays, generator)
    values = sample_values(field, rays, marched)
    marched_pixels = on_background(marched.blended(values.radiance), marched.alpha, batch.background, linear=True)
    light = RecoveredLight(model.light, variant, budget.light_rows, budget.secondary_samples, displaced=True)
    shaded_pixels = shaded_on_background(field, batch, values, light, generator)
    return {
        "radiance": weights.radiance * squared_error(marched_pixels, batch.target),
        "shaded": weights.shaded * squared_error(shaded_pixels, batch.target),
        "sparsity": weights.sparsity * sparsity(field),
        **_normal_losses(values, rays, variant),
        **_smoothness(field, values, variant, generator),
    }


def shaded_on_background(
    field: Field, batch: RayBatch, values: SampleValues, light: RecoveredLight, generator: torch.Generator
) -> Float[Tensor, "rays 3"]:
    """Shaded pixels in display sRGB, clipped to [0, 1] before encoding; rays without a surface show the background."""
    points = surface_points(batch.rays, values.marched, values.materials(light.variant.normals))
    shaded = light.on(field, points, generator)
    colour = srgb_encode((shaded.direct + shaded.indirect).clamp(0, 1))
    return batch.background.expand(-1, 3).index_copy(0, points.ray, colour)


def _normal_losses(values: SampleValues, rays: Rays, variant: Variant) -> dict[str, Tensor]:
    """Orientation loss of the shading normals, and the distance of predicted from derived normals."""
    weights, normal, losses = variant.learning.inverse, values.derived, {}
    if variant.normals == "predicted":
        normal = values.predicted
        apart = (values.predicted - values.derived).square().sum(-1)
        losses["normal difference"] = weights.normal_difference * mean_along_rays(values.marched, apart)
    away = facing_away(normal, rays.direction[values.marched.ray])
    return losses | {"orientation": weights.orientation * mean_along_rays(values.marched, away)}


def _smoothness(field: Field, values: SampleValues, variant: Variant, generator: torch.Generator) -> dict[str, Tensor]:
    """Losses between the materials of samples and of random nearby positions."""
    weights, position = variant.learning.inverse, values.marched.positions
    displacement = torch.randn(position.shape, generator=generator, dtype=position.dtype, device=position.device)
    nearby = position + variant.learning.nearby * displacement
    albedo, roughness = field.materials(field.features(nearby), nearby)
    of_albedo = relative_difference(values.albedo, albedo)
    of_roughness = relative_difference(values.roughness[:, None], roughness[:, None])
    return {
        "albedo smoothness": weights.albedo_smoothness * mean_along_rays(values.marched, of_albedo),
        "roughness smoothness": weights.roughness_smoothness * mean_along_rays(values.marched, of_roughness),
    }


MOMENTS = (0.9, 0.99)
"""Adam's decay rates of the two moments."""


class Optimiser:
    """Adam with one rate for grids and another for networks and light; the rates decay geometrically.

    They reach ``rates.end`` times their initial values after ``total`` steps, and restart when parameters are replaced.
    """

    def __init__(self, parameters: Mapping[str, Tensor], rates: Rates, network_rate: float, total: int) -> None:
        self.rates, self.network_rate, self.total = rates, network_rate, total
        self.since = 0
        self.replace(parameters)

    def replace(self, parameters: Mapping[str, Tensor]) -> None:
        """Restart with other parameters: without moments and at the initial rates."""
        self.since = 0
        self.tensors = {name: value.detach().clone().requires_grad_() for name, value in parameters.items()}
        groups = [{"params": [value], "name": name} for name, value in self.tensors.items()]
        self.adam = torch.optim.Adam(groups, betas=MOMENTS)

    def step(self) -> None:
        """Do one step, then clear the gradients."""
        decay = self.rates.end ** (self.since / self.total)
        for group in self.adam.param_groups:
            on_grid = group["name"] in GRIDS
            group["lr"] = decay * (self.rates.grid if on_grid else self.rates.network * self.network_rate)
        self.adam.step()
        self.adam.zero_grad()
        self.since += 1

    def state(self) -> dict[str, Any]:
        """All values needed to resume bit for bit."""
        moments = {
            name: dict(self.adam.state[value]) for name, value in self.tensors.items() if value in self.adam.state
        }
        return {"tensors": self.plain(), "moments": moments, "since": self.since}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.replace(state["tensors"])
        self.since = state["since"]
        for name, moments in state["moments"].items():
            self.adam.state[self.tensors[name]] = {key: value.clone() for key, value in moments.items()}

    def plain(self) -> dict[str, Tensor]:
        """The parameters, detached."""
        return {name: value.detach() for name, value in self.tensors.items()}
