"""The bounding volume hierarchy that rays traverse: an eight-wide tree over surfels, with eight surfels in each leaf.

On the CPU the tree is built by the surface-area heuristic, on CUDA in k-d order (by sorting only). After the surfels
move, boxes are refitted level by level, first the leaves', then the nodes', deepest first; a tree whose boxes have
grown too much is built again.
"""

from dataclasses import dataclass, fields
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import torch
import warp as wp
from jaxtyping import Float, Float64
from torch import Tensor

from ..arrangement import as_on_cuda
from ..native_kernel import BYTES, DOUBLES, INTEGERS, flat, native_file, native_kernel
from ..runtime import UNFUSED, launch, launch_in_parallel
from ..surfel.geometry import SplatGeometry
from ..surfel.support import REGULAR, count_kinds, support_of
from .topology import WIDTH, Topology, kd_topology, sah_topology

FIT = native_file(__package__, "fit.inl")

EMPTY = 1e30
"""Corner of an empty box, which no ray hits: low = EMPTY, high = -EMPTY. It is finite, so that 0 * EMPTY is not NaN."""

RELATIVE_PADDING = 1e-5
"""Share of its extent by which a box is enlarged, against rounding."""

COORDINATE_PADDING = 1e-6
"""Share of its coordinates by which a box is enlarged: about 10 ulp of float32, against rounding."""

LEAF_FIELDS = 14
"""Numbers of each surfel in a leaf: centre (3), axis_u (3), axis_v (3), normal (3), opacity, squared support radius."""

LOOSENED = 1.1
"""Growth of a ray's expected visits at which the tree is built again. A build takes as long as six to nine refits, and
a twentieth of the time of an iteration's rays, so ten percent more traversal already costs more."""


@dataclass
class SurfelBVH:
    """The tree, fitted to surfels; without gradient."""

    topology: Topology
    """Children of each node and surfels of each leaf."""
    boxes: Float[Tensor, "nodes 48"]
    """Boxes of each node's eight children: their low x, then low y, low z, high x, high y and high z."""
    leaves: Float[Tensor, "leaves fields 8"]
    """The LEAF_FIELDS of each leaf's eight surfels; all zero for an empty entry, which faces no ray."""
    areas: Float64[Tensor, " nodes_and_leaves"]
    """Half the surface area of the box around each node, then around each leaf."""
    visits_when_built: float = 0.0
    """``expected_visits`` when the topology was built."""

    @classmethod
    def build(cls, geometry: SplatGeometry, topology: Topology | None = None) -> "SurfelBVH":
        """Sort the surfels into leaves, unless a topology is given, and fit the boxes."""
        new = geometry.centre.new_empty
        tree = cls(
            topology or _topology(geometry), new(0, 6 * WIDTH), new(0, LEAF_FIELDS, WIDTH), new(0, dtype=torch.float64)
        )
        tree._fit(geometry)
        tree.visits_when_built = tree.expected_visits
        return tree

    def refit(self, geometry: SplatGeometry) -> None:
        """Fit the boxes to the same surfels after a move; build the tree again if it is LOOSENED."""
        self._fit(geometry)
        if self.expected_visits > LOOSENED * self.visits_when_built:
            self.topology = _topology(geometry)
            self._fit(geometry)
            self.visits_when_built = self.expected_visits

    @property
    def expected_visits(self) -> float:
        """Expected number of nodes and leaves that a random line through the root's box visits: the sum of all areas
        over the root's area."""
        whole, total = torch.stack([self.areas[0], self.areas.sum()]).tolist()
        return float((total - whole) / whole) if whole > 0 else 0.0

    @torch.no_grad()
    def _fit(self, geometry: SplatGeometry) -> None:
        child, order = self.topology.child, self.topology.order
        centre, nodes, leaves = geometry.centre, len(child), len(order)
        self.boxes = centre.new_empty(nodes, 6 * WIDTH)
        self.leaves = centre.new_empty(leaves, LEAF_FIELDS, WIDTH)
        self.areas = centre.new_empty(nodes + leaves, dtype=torch.float64)
        bounds = [centre.new_empty(nodes + leaves, 6), self.areas]
        support = support_of(geometry)
        count_kinds(support.kind)
        surfels = [getattr(geometry, field.name).contiguous() for field in fields(geometry)]
        of_leaves = [nodes, order, *surfels, support.radius, support.extent, support.kind, self.leaves, *bounds]
        kernels = fit_kernels(centre.dtype)
        launch_in_parallel(kernels.leaves, leaves, centre.device, of_leaves)
        of_nodes = [nodes, leaves, child, self.boxes, *bounds]
        # On the CPU items run in order, so one launch is enough: children have greater numbers than their parent.
        ends = self.topology.level_end if as_on_cuda(centre.device) else (nodes,)
        for begin, end in reversed(list(pairwise((0, *ends)))):
            launch(kernels.nodes, end - begin, centre.device, [end, *of_nodes])


def _topology(geometry: SplatGeometry) -> Topology:
    """The topology over all surfels, also surfels that no ray can hit: a later refit may make them visible."""
    with torch.no_grad():
        centre = torch.where(torch.isfinite(geometry.centre).all(-1, keepdim=True), geometry.centre, 0.0)
        if as_on_cuda(centre.device):
            return kd_topology(centre)
        support = support_of(geometry)
        extent = torch.where(support.can_be_hit[:, None], support.extent, 0.0)
        return sah_topology(centre - extent, centre + extent)


class FitKernels(NamedTuple):
    """Kernels that fit a tree to its surfels.

    ``corners``: low x, y, z and high x, y, z of the box around each node, then around each leaf. ``areas``: half the
    surface area of these boxes.
    """

    leaves: wp.Kernel
    """Fits each leaf; an item is a leaf."""
    nodes: wp.Kernel
    """Fits the nodes before ``end`` from the last one backwards, after the boxes of their children."""


@cache
def fit_kernels(dtype: torch.dtype) -> FitKernels:
    """The kernels for a scalar type."""
    words = {
        "LEAF_FIELDS": LEAF_FIELDS,
        "WIDTH": WIDTH,
        "EMPTY": EMPTY,
        "REGULAR": REGULAR,
        "RELATIVE_PADDING": RELATIVE_PADDING,
        "COORDINATE_PADDING": COORDINATE_PADDING,
    }
    make, arrays = partial(native_kernel, FIT, dtype, UNFUSED, words=words), flat(dtype)
    of_leaves = (
        (wp.int32, "nodes"),
        (INTEGERS, "order"),
        (arrays, "centre axis_u axis_v normal opacity radius extent"),
        (BYTES, "kind"),
        (arrays, "leaves corners"),
        (DOUBLES, "areas"),
    )
    of_nodes = (wp.int32, "end nodes leaves"), (INTEGERS, "children"), (arrays, "boxes corners"), (DOUBLES, "areas")
    return FitKernels(make("fit_leaf", "leaf", *of_leaves), make("fit_node", "before", *of_nodes))
