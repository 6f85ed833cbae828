"""The bounding volumes that rays are traced through: an eight-wide tree over surfels, eight surfels a leaf.

On the CPU the tree is built by the surface-area heuristic, on CUDA in k-d order (sorting alone). Refitting after the
surfels moved is a minimum and a maximum per level; a tree that has loosened too much is built anew.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ..arrangement import as_on_cuda
from ..surfel.geometry import SplatGeometry
from ..surfel.support import Support, support_of
from .topology import WIDTH, Topology, kd_topology, sah_topology

EMPTY = 1e30
"""Corner of a box that no ray meets: low = EMPTY, high = -EMPTY. Finite, so that 0 * EMPTY stays a number."""

RELATIVE_PADDING = 1e-5
COORDINATE_PADDING = 1e-6
"""Boxes grow by these shares of their extent and of their coordinates: about 10 ulp of float32, against rounding."""

LEAF_FIELDS = 14
"""Per surfel of a leaf: centre (3), axis_u (3), axis_v (3), normal (3), opacity, squared support radius."""

LOOSENED = 1.1
"""Build anew when the expected visits of a ray have grown by this factor: a build takes as long as about three refits
and a twentieth of the rays that an iteration traces, so that a tenth more traversal already costs more."""


@dataclass
class SurfelBVH:
    """The tree, and the surfels that it was last fitted to.

    boxes: per node its children's low x, y, z and high x, y, z, eight abreast. leaves: per leaf the LEAF_FIELDS of its
    surfels, eight abreast; an empty place is all zero and faces no ray.
    """

    topology: Topology
    boxes: Float[Tensor, "nodes 48"]
    leaves: Float[Tensor, "leaves fields 8"]
    visits_when_built: float = 0.0

    @classmethod
    def build(cls, geometry: SplatGeometry) -> "SurfelBVH":
        """Sort the surfels into leaves and fit the boxes; nothing here carries gradient."""
        return cls.over(_topology(geometry), geometry)

    @classmethod
    def over(cls, topology: Topology, geometry: SplatGeometry) -> "SurfelBVH":
        """A tree of that topology, fitted."""
        new = geometry.centre.new_empty
        tree = cls(topology, new(0, 6 * WIDTH), new(0, LEAF_FIELDS, WIDTH))
        tree._fit(geometry)
        tree.visits_when_built = tree.expected_visits
        return tree

    def refit(self, geometry: SplatGeometry) -> None:
        """Follow the same surfels to where they moved: new boxes, or a new tree once it is LOOSENED."""
        self._fit(geometry)
        if self.expected_visits > LOOSENED * self.visits_when_built:
            self.topology = _topology(geometry)
            self._fit(geometry)
            self.visits_when_built = self.expected_visits

    @property
    def expected_visits(self) -> float:
        """Nodes and leaves that a random line through the root's box visits: the sum of areas over the root's."""
        low, high = self.boxes.view(-1, 2, 3, WIDTH).unbind(1)
        half_area = _half_area((high - low).clamp(min=0).mT)
        whole = _half_area((high[0].amax(1) - low[0].amin(1)).clamp(min=0))
        return float(torch.where(whole > 0, half_area.sum() / whole, 0.0))

    @torch.no_grad()
    def _fit(self, geometry: SplatGeometry) -> None:
        child, order = self.topology.child.long(), self.topology.order.long()
        nodes = len(child)
        # Boxes of all nodes, then of all leaves, then the empty one that absent children point to.
        place = torch.where(child >= 0, child, nodes - 1 - child)
        low, high = (value.new_empty(nodes + len(order) + 1, 3) for value in 2 * [geometry.centre])
        support = support_of(geometry).counted()
        surfel_low, surfel_high = _surfel_boxes(geometry.centre, support)
        low[nodes:], high[nodes:] = EMPTY, -EMPTY
        low[nodes:-1] = surfel_low[order].amin(1)
        high[nodes:-1] = surfel_high[order].amax(1)
        self.leaves = _records(geometry, support)[order].mT.contiguous()
        self.boxes = geometry.centre.new_empty(nodes, 6 * WIDTH)
        ends = self.topology.level_end
        for begin, end in reversed(list(zip((0, *ends), ends, strict=False))):
            inner_low, inner_high = low[place[begin:end]], high[place[begin:end]]
            self.boxes[begin:end] = torch.cat([inner_low.mT, inner_high.mT], 1).flatten(1)
            low[begin:end], high[begin:end] = inner_low.amin(1), inner_high.amax(1)


def _topology(geometry: SplatGeometry) -> Topology:
    """Surfels that no ray can meet now have a place too: they may return while the tree is refitted."""
    with torch.no_grad():
        centre = torch.where(torch.isfinite(geometry.centre).all(-1, keepdim=True), geometry.centre, 0.0)
        if as_on_cuda(centre.device):
            return kd_topology(centre)
        support = support_of(geometry)
        extent = torch.where(support.can_be_met[:, None], support.extent, 0.0)
        return sah_topology(centre - extent, centre + extent)


def _half_area(side: Float[Tensor, "*boxes 3"]) -> Float[Tensor, "*boxes"]:
    x, y, z = side.double().unbind(-1)
    return x * y + y * z + z * x


def _surfel_boxes(
    centre: Float[Tensor, "surfels 3"], support: Support
) -> tuple[Float[Tensor, "surfels_and_none 3"], ...]:
    """Corners of every surfel's padded box, and of an empty one after the last."""
    extent, alive = support.extent, support.can_be_met[:, None]
    padded = extent + RELATIVE_PADDING * extent.amax(-1, keepdim=True) + COORDINATE_PADDING * centre.abs()
    low = torch.where(alive, centre - padded, EMPTY)
    high = torch.where(alive, centre + padded, -EMPTY)
    return torch.cat([low, low.new_full((1, 3), EMPTY)]), torch.cat([high, high.new_full((1, 3), -EMPTY)])


def _records(geometry: SplatGeometry, support: Support) -> Float[Tensor, "surfels_and_none fields"]:
    columns = [geometry.centre, geometry.axis_u, geometry.axis_v, geometry.normal]
    fields = torch.cat([*columns, geometry.opacity[:, None], support.radius.square()[:, None]], -1)
    fields = torch.where(support.can_be_met[:, None], fields, 0.0)
    return torch.cat([fields, fields.new_zeros(1, LEAF_FIELDS)])
