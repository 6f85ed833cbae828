"""The field: density and features of places by vector-matrix factors, and what the networks make of features."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import softplus

from .box import Box, cell_centres, widened
from .interpolation import finer_lines, finer_planes, nodes_around, products, slope_of_sum
from .networks import answer, network_start
from .variant import Budget

DENSITY_SHIFT = -10.0
"""Added to the sum of factors inside the softplus: space starts nearly empty."""

DENSITY_SCALE = 25.0
"""Density is this times the softplus, by a length of which the half edge of the box has ``UNITS``."""

UNITS = 1.5
"""TensoIR's boxes are [-1.5, 1.5]^3; its constants in units of length are divided by this."""

START_FACTOR = 0.1
"""Standard deviation of the factors' entries at the start."""

FLATTEST = 1e-6
"""Squared slope below which a derived normal is shorter than one."""

ROUGHNESS_LOW, ROUGHNESS_RANGE = 0.09, 0.9
"""Perceptual roughness is the first plus the second times a share in [0, 1]."""

HOLDS_ANYTHING = 1e-4
"""Opacity along half a grid step below which a cell counts as empty."""

POINTS_AT_ONCE = 1 << 18

GRIDS = ("density_plane", "density_line", "appearance_plane", "appearance_line")
"""Parameters that lie on the grid; the others are of networks."""


@dataclass(frozen=True)
class Field:
    """A vector-matrix factorised field in a box. Places are local to it (see ``Box``), densities per local length.

    ``parameters``: ``GRIDS`` ([3, size, size, components] and [3, size, components]), ``basis`` [features, 3 *
    components], and the weights of the networks ``radiance``, ``brdf`` and ``normal``.
    """

    box: Box
    parameters: Mapping[str, Tensor]

    @property
    def size(self) -> int:
        """Nodes of the grid along an edge."""
        return self.parameters["density_line"].shape[1]

    @property
    def spacing(self) -> float:
        """Distance of neighbouring nodes."""
        return 2 / (self.size - 1)

    def density(self, place: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """Density per local length; that of the factors, whether or not the box's cell is occupied."""
        grids, nodes = self.parameters, nodes_around(place, self.size)
        total = products(grids["density_plane"], grids["density_line"], nodes).sum((-2, -1))
        return (DENSITY_SCALE * UNITS) * softplus(total + DENSITY_SHIFT)

    def derived_normal(self, place: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Minus the normalised gradient of density: unit, in the world; shorter only where density is flat."""
        grids, nodes = self.parameters, nodes_around(place, self.size)
        # The softplus only scales the gradient.
        slope = slope_of_sum(grids["density_plane"], grids["density_line"], nodes)
        return -slope * slope.square().sum(-1, keepdim=True).clamp(min=FLATTEST).rsqrt()

    def features(self, place: Float[Tensor, "points 3"]) -> Float[Tensor, "points features"]:
        """What the networks read."""
        grids, nodes = self.parameters, nodes_around(place, self.size)
        factors = products(grids["appearance_plane"], grids["appearance_line"], nodes)
        return factors.flatten(1) @ grids["basis"].T

    def radiance(
        self, features: Float[Tensor, "points features"], direction: Float[Tensor, "points 3"]
    ) -> Float[Tensor, "points 3"]:
        """Radiance in [0, 1] that is seen along unit directions, which point away from who looks."""
        return answer("radiance", self.parameters, torch.cat([features, direction], -1)).sigmoid()

    def materials(
        self, features: Float[Tensor, "points features"], place: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, " points"]]:
        """Linear diffuse albedo, and perceptual roughness."""
        found = answer("brdf", self.parameters, torch.cat([features, place], -1)).sigmoid()
        return found[:, :3], ROUGHNESS_LOW + ROUGHNESS_RANGE * found[:, 3]

    def predicted_normal(
        self, features: Float[Tensor, "points features"], place: Float[Tensor, "points 3"]
    ) -> Float[Tensor, "points 3"]:
        """The normal that the network says; its components are in [-1, 1] and its length is whatever comes out."""
        return answer("normal", self.parameters, torch.cat([features, place], -1)).tanh()

    @torch.no_grad()
    def finer(self, size: int) -> "Field":
        """The field on a grid of another size."""
        changed = {
            name: (finer_planes if name.endswith("plane") else finer_lines)(self.parameters[name].detach(), size)
            for name in GRIDS
        }
        return replace(self, parameters={**self.parameters, **changed})

    @torch.no_grad()
    def emptied(self) -> "Field":
        """The field without the cells in whose neighbourhood there is hardly any density."""
        place = cell_centres(self.box.cells, device=self.box.centre.device)
        density = torch.cat([self.density(some) for some in place.split(POINTS_AT_ONCE)])
        solid = 1 - torch.exp(-density * self.spacing / 2) > HOLDS_ANYTHING
        return replace(self, box=self.box.narrowed(widened(solid.view_as(self.box.occupied))))


def field_start(box: Box, budget: Budget, generator: torch.Generator) -> Field:
    """Random factors and networks; nearly empty."""
    size = budget.grid_start
    drawn = {
        "density_plane": (3, size, size, budget.density_components),
        "density_line": (3, size, budget.density_components),
        "appearance_plane": (3, size, size, budget.appearance_components),
        "appearance_line": (3, size, budget.appearance_components),
    }
    device, features, hidden = generator.device, budget.features, budget.hidden
    grids = {
        name: START_FACTOR * torch.randn(shape, generator=generator, device=device) for name, shape in drawn.items()
    }
    inputs = 3 * budget.appearance_components
    uniform = 2 * torch.rand(features, inputs, generator=generator, device=device) - 1
    parameters = {
        **grids,
        "basis": uniform / inputs**0.5,
        **network_start("radiance", features + 3, hidden, 3, generator),
        **network_start("brdf", features + 3, hidden, 4, generator),
        **network_start("normal", features + 3, hidden, 3, generator),
    }
    return Field(box, parameters)
