"""The stages of TensoIR: a radiance field from the training images, then its materials and the light beside it.

Both learn with Adam on named parameters whose shapes may change. The second one compares marched and shaded pixels with
the images, and ties normals and materials down.
"""

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
from .drawing import Drawn, drawn_rays
from .field import GRIDS, Field, field_start
from .light import SphericalGaussians, light_start
from .lighting import RecoveredLight
from .losses import facing_away, mean_along_rays, on_background, relative_difference, sparsity, squared_error, variation
from .marching import Rays, march
from .model import LIGHT, Model
from .seen import Seen, seen_along
from .settings import Budget, Rates, Variant
from .shading import surface_points


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


def inverse_losses(
    model: Model, drawn: Drawn, variant: Variant, budget: Budget, generator: torch.Generator
) -> dict[str, Tensor]:
    """The weighted losses of some rays by name; ``generator`` displaces samples, directions and neighbours."""
    weights, field, rays = variant.learning.inverse, model.field, drawn.rays
    marched = march(field, rays, generator)
    seen = seen_along(field, rays, marched)
    marched_pixels = on_background(marched.blended(seen.radiance), marched.alpha, drawn.background, linear=True)
    light = RecoveredLight(model.light, variant, budget.light_rows, budget.secondary_samples, displaced=True)
    shaded_pixels = shaded_on_background(field, drawn, seen, light, generator)
    return {
        "radiance": weights.radiance * squared_error(marched_pixels, drawn.target),
        "shaded": weights.shaded * squared_error(shaded_pixels, drawn.target),
        "sparsity": weights.sparsity * sparsity(field),
        **_normal_losses(seen, rays, variant),
        **_smoothness(field, seen, variant, generator),
    }


def shaded_on_background(
    field: Field, drawn: Drawn, seen: Seen, light: RecoveredLight, generator: torch.Generator
) -> Float[Tensor, "rays 3"]:
    """Shaded pixels as display sRGB: clipped to [0, 1] before they are encoded; the background elsewhere."""
    points = surface_points(drawn.rays, seen.marched, seen.materials(light.variant.normals))
    shaded = light.on(field, points, generator)
    colour = srgb_encode((shaded.direct + shaded.indirect).clamp(0, 1))
    return drawn.background.expand(-1, 3).index_copy(0, points.ray, colour)


def _normal_losses(seen: Seen, rays: Rays, variant: Variant) -> dict[str, Tensor]:
    """Normals that are shaded with face the camera; predicted ones are those of the density."""
    weights, direction = variant.learning.inverse, rays.direction[seen.marched.ray]
    if variant.normals == "derived":
        away = facing_away(seen.derived, direction)
        return {"orientation": weights.orientation * mean_along_rays(seen.marched, away)}
    apart = (seen.predicted - seen.derived).square().sum(-1)
    away = facing_away(seen.predicted, direction)
    return {
        "normal difference": weights.normal_difference * mean_along_rays(seen.marched, apart),
        "orientation": weights.orientation * mean_along_rays(seen.marched, away),
    }


def _smoothness(field: Field, seen: Seen, variant: Variant, generator: torch.Generator) -> dict[str, Tensor]:
    """Materials here and a little beside."""
    weights, place = variant.learning.inverse, seen.marched.places
    drawn = torch.randn(place.shape, generator=generator, dtype=place.dtype, device=place.device)
    beside = place + variant.learning.nearby * drawn
    albedo, roughness = field.materials(field.features(beside), beside)
    of_albedo = relative_difference(seen.albedo, albedo)
    of_roughness = relative_difference(seen.roughness[:, None], roughness[:, None])
    return {
        "albedo smoothness": weights.albedo_smoothness * mean_along_rays(seen.marched, of_albedo),
        "roughness smoothness": weights.roughness_smoothness * mean_along_rays(seen.marched, of_roughness),
    }


MOMENTS = (0.9, 0.99)
"""Decay of Adam's moments."""


class Optimiser:
    """Grids step at one rate, networks and light at another; both fall from where the grid was last made finer.

    ``total``: steps over which they fall to ``rates.end``.
    """

    def __init__(self, parameters: Mapping[str, Tensor], rates: Rates, network_rate: float, total: int) -> None:
        self.rates, self.network_rate, self.total = rates, network_rate, total
        self.since = 0
        self.replace(parameters)

    def replace(self, parameters: Mapping[str, Tensor]) -> None:
        """Begin anew with other parameters: without moments, and at the first rates."""
        self.since = 0
        self.tensors = {name: value.detach().clone().requires_grad_() for name, value in parameters.items()}
        groups = [{"params": [value], "name": name} for name, value in self.tensors.items()]
        self.adam = torch.optim.Adam(groups, betas=MOMENTS)

    def step(self) -> None:
        """One step; gradients are gone afterwards."""
        left = self.rates.end ** (self.since / self.total)
        for group in self.adam.param_groups:
            on_grid = group["name"] in GRIDS
            group["lr"] = left * (self.rates.grid if on_grid else self.rates.network * self.network_rate)
        self.adam.step()
        self.adam.zero_grad()
        self.since += 1

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
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
        """The parameters without gradient history."""
        return {name: value.detach() for name, value in self.tensors.items()}
