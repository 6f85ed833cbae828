"""The field: density and features by vector-matrix factors, and networks that read the features.

Factor m is a plane over two axes of a cubic grid times a line over the third. Planes are interpolated bilinearly and
lines linearly; the first and last node lie on the faces of the cube.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import embedding, interpolate, linear, softplus

from .box import Box, cell_centres, widened
from .settings import Budget

DENSITY_SHIFT = -10.0
"""Added to the sum of factors before the softplus, so that space starts nearly empty."""

DENSITY_SCALE = 25.0
"""Density is the softplus times this, per TensoIR's unit of length; half an edge of the box is ``UNITS`` of these."""

UNITS = 1.5
"""Half an edge of TensoIR's boxes, [-1.5, 1.5]^3: the published lengths are divided by it to become local."""

START_FACTOR = 0.1
"""Initial standard deviation of the factors' entries."""

FLATTEST = 1e-6
"""Squared density gradient below which a derived normal is shorter than one."""

ROUGHNESS_LOW, ROUGHNESS_RANGE = 0.09, 0.9
"""Perceptual roughness is LOW + RANGE times the network's output in [0, 1]."""

EMPTY_OPACITY = 1e-4
"""Opacity over half a grid spacing below which a cell counts as empty."""

POINTS_AT_ONCE = 1 << 18
"""Points whose density is computed in one batch."""

GRIDS = ("density_plane", "density_line", "appearance_plane", "appearance_line")
"""Names of the parameters on the grid; all others belong to networks."""


@dataclass(frozen=True)
class Field:
    """A vector-matrix factorised field in a box. Positions are local (see ``Box``), densities per local length."""

    box: Box
    """Bounding cube and occupied cells."""
    parameters: Mapping[str, Tensor]
    """``GRIDS`` ([3, size, size, components] and [3, size, components]), ``basis`` [features, 3 * components], and the
    weights of the networks ``radiance``, ``brdf`` and ``normal``."""

    @property
    def size(self) -> int:
        """Number of nodes of the grid along an edge."""
        return self.parameters["density_line"].shape[1]

    @property
    def spacing(self) -> float:
        """Distance of neighbouring nodes, local length."""
        return 2 / (self.size - 1)

    def density(self, position: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        """Density of the factors, per local length; occupancy of the box's cells is ignored."""
        grids, nodes = self.parameters, nodes_around(position, self.size)
        total = products(grids["density_plane"], grids["density_line"], nodes).sum((-2, -1))
        return (DENSITY_SCALE * UNITS) * softplus(total + DENSITY_SHIFT)

    def derived_normal(self, position: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """Minus the normalised gradient of density, world axes; shorter than one only where density is nearly flat."""
        grids, nodes = self.parameters, nodes_around(position, self.size)
        # The softplus only scales the gradient, so the gradient of its input has the same direction.
        slope = slope_of_sum(grids["density_plane"], grids["density_line"], nodes)
        return -slope * slope.square().sum(-1, keepdim=True).clamp(min=FLATTEST).rsqrt()

    def features(self, position: Float[Tensor, "points 3"]) -> Float[Tensor, "points features"]:
        """Appearance features, the input of the networks."""
        grids, nodes = self.parameters, nodes_around(position, self.size)
        factors = products(grids["appearance_plane"], grids["appearance_line"], nodes)
        return factors.flatten(1) @ grids["basis"].T

    def radiance(
        self, features: Float[Tensor, "points features"], direction: Float[Tensor, "points 3"]
    ) -> Float[Tensor, "points 3"]:
        """Radiance in [0, 1] seen along unit ``direction``, which points away from the viewer."""
        return network_output("radiance", self.parameters, torch.cat([features, direction], -1)).sigmoid()

    def materials(
        self, features: Float[Tensor, "points features"], position: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, "points 3"], Float[Tensor, " points"]]:
        """Linear diffuse albedo in [0, 1], and perceptual roughness."""
        found = network_output("brdf", self.parameters, torch.cat([features, position], -1)).sigmoid()
        return found[:, :3], ROUGHNESS_LOW + ROUGHNESS_RANGE * found[:, 3]

    def predicted_normal(
        self, features: Float[Tensor, "points features"], position: Float[Tensor, "points 3"]
    ) -> Float[Tensor, "points 3"]:
        """Normals predicted by the network, world axes; components are in [-1, 1], the length is not normalised."""
        return network_output("normal", self.parameters, torch.cat([features, position], -1)).tanh()

    @torch.no_grad()
    def finer(self, size: int) -> "Field":
        """The field resampled to a grid with ``size`` nodes along an edge, without gradient."""
        changed = {name: resampled(self.parameters[name].detach(), size) for name in GRIDS}
        return replace(self, parameters={**self.parameters, **changed})

    @torch.no_grad()
    def emptied(self) -> "Field":
        """The field with cells marked empty if they and their 26 neighbours have hardly any density."""
        position = cell_centres(self.box.cells, device=self.box.centre.device)
        density = torch.cat([self.density(some) for some in position.split(POINTS_AT_ONCE)])
        solid = 1 - torch.exp(-density * self.spacing / 2) > EMPTY_OPACITY
        return replace(self, box=self.box.narrowed(widened(solid.view_as(self.box.occupied))))


def field_start(box: Box, budget: Budget, generator: torch.Generator) -> Field:
    """Initial field with random factors and networks; space is nearly empty."""
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


PLANES, LINES = ((0, 1), (0, 2), (1, 2)), (2, 1, 0)
"""Axes (x, y, z as 0, 1, 2) of each factor's plane and line."""


@dataclass(frozen=True)
class Nodes:
    """The grid nodes around points, and their interpolation weights."""

    plane: Int[Tensor, "points 3 4"]
    """Rows of the flattened planes."""
    plane_weight: Float[Tensor, "points 3 4"]
    """Bilinear weights of ``plane``."""
    line: Int[Tensor, "points 3 2"]
    """Rows of the flattened lines."""
    line_weight: Float[Tensor, "points 3 2"]
    """Linear weights of ``line``."""
    between: tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]
    """Distance from the lower node along the first and the second axis of each plane, in grid spacings, in [0, 1]."""
    per_unit: float
    """Grid spacings in a local length of 1."""

    def plane_slopes(self) -> tuple[Float[Tensor, "points 3 4"], Float[Tensor, "points 3 4"]]:
        """Derivatives of ``plane_weight`` with respect to the local coordinates along the plane's two axes."""
        u, v = self.between
        return (
            self.per_unit * torch.stack([v - 1, -v, 1 - v, v], -1),
            self.per_unit * torch.stack([u - 1, 1 - u, -u, u], -1),
        )


def nodes_around(position: Float[Tensor, "points 3"], size: int) -> Nodes:
    """Nodes around local positions on grids of ``size`` nodes along an edge; positions are clamped to the cube."""
    scaled = (position.clamp(-1, 1) + 1) * ((size - 1) / 2)
    first = scaled.detach().floor().clamp(0, size - 2)
    share, first = scaled - first, first.long()
    u, v = (share[:, [axes[side] for axes in PLANES]] for side in (0, 1))
    row, column = (first[:, [axes[side] for axes in PLANES]] for side in (0, 1))
    factor = torch.arange(3, device=position.device)
    corner = (factor * size + row) * size + column
    start, along = factor * size + first[:, LINES], share[:, LINES]
    return Nodes(
        plane=torch.stack([corner, corner + 1, corner + size, corner + size + 1], -1),
        plane_weight=torch.stack([(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v], -1),
        line=torch.stack([start, start + 1], -1),
        line_weight=torch.stack([1 - along, along], -1),
        between=(u, v),
        per_unit=(size - 1) / 2,
    )


def products(
    planes: Float[Tensor, "3 size size components"], lines: Float[Tensor, "3 size components"], nodes: Nodes
) -> Float[Tensor, "points 3 components"]:
    """Product of the interpolated plane and line, for every factor and component."""
    plane = (embedding(nodes.plane, planes.flatten(0, 2)) * nodes.plane_weight[..., None]).sum(-2)
    line = (embedding(nodes.line, lines.flatten(0, 1)) * nodes.line_weight[..., None]).sum(-2)
    return plane * line


def slope_of_sum(
    planes: Float[Tensor, "3 size size components"], lines: Float[Tensor, "3 size components"], nodes: Nodes
) -> Float[Tensor, "points 3"]:
    """Gradient of the sum of all ``products`` with respect to the local coordinates."""
    corners = embedding(nodes.plane, planes.flatten(0, 2))
    ends = embedding(nodes.line, lines.flatten(0, 1))
    plane, line = (corners * nodes.plane_weight[..., None]).sum(-2), (ends * nodes.line_weight[..., None]).sum(-2)
    across = [(corners * slope[..., None]).sum(-2) * line for slope in nodes.plane_slopes()]
    along = plane * (ends[:, :, 1] - ends[:, :, 0]) * nodes.per_unit
    slope: list[Tensor] = [along.new_zeros(len(along))] * 3
    for factor in range(3):
        for axis, part in zip((*PLANES[factor], LINES[factor]), (*across, along), strict=True):
            slope[axis] = slope[axis] + part[:, factor].sum(-1)
    return torch.stack(slope, -1)


def resampled(grids: Float[Tensor, "3 *size components"], size: int) -> Float[Tensor, "3 *resampled components"]:
    """Planes or lines on ``size`` nodes along an edge; unchanged functions if the old nodes are among the new ones."""
    moved, sizes = grids.movedim(-1, 1), (size,) * (grids.dim() - 2)
    mode = "linear" if len(sizes) == 1 else "bilinear"
    return interpolate(moved, size=sizes, mode=mode, align_corners=True).movedim(1, -1).contiguous()


FREQUENCIES = 2
"""Number of frequencies of the positional encoding: sines and cosines of 1 and 2 times each input."""

LAYERS = 3
"""Linear layers of each network."""

ENCODED = 1 + 2 * FREQUENCIES
"""Encoded values of each input."""


def encoded(values: Float[Tensor, "points inputs"]) -> Float[Tensor, "points encoded"]:
    """Positional encoding: the values, and the sines and cosines of 1, 2, ... times them."""
    octaves = [values * 2.0**octave for octave in range(FREQUENCIES)]
    return torch.cat([values, *(wave for each in octaves for wave in (each.sin(), each.cos()))], -1)


def network_start(
    name: str, inputs: int, hidden: int, outputs: int, generator: torch.Generator
) -> dict[str, Float[Tensor, "..."]]:
    """Initial weights uniform in +-1 / sqrt(inputs of the layer) and zero biases, on the generator's device."""
    widths = [inputs * ENCODED, hidden, hidden, outputs]
    found: dict[str, Tensor] = {}
    for layer in range(LAYERS):
        bound = 1 / math.sqrt(widths[layer])
        drawn = torch.rand(widths[layer + 1], widths[layer], generator=generator, device=generator.device)
        found[f"{name}_weight_{layer}"] = (2 * drawn - 1) * bound
        found[f"{name}_bias_{layer}"] = torch.zeros(widths[layer + 1], device=generator.device)
    return found


def network_output(
    name: str, parameters: Mapping[str, Tensor], inputs: Float[Tensor, "points inputs"]
) -> Float[Tensor, "points outputs"]:
    """Outputs of the network ``name`` without an activation of the last layer."""
    values = encoded(inputs)
    for layer in range(LAYERS):
        values = linear(values, parameters[f"{name}_weight_{layer}"], parameters[f"{name}_bias_{layer}"])
        values = values.relu() if layer < LAYERS - 1 else values
    return values
