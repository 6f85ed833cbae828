"""Kernels that fit a tree to its surfels: one item a leaf, then one item a node, deepest nodes first."""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import UNFUSED, scalar_type, start_warp
from ..surfel.support_source import REGULAR
from .topology import WIDTH

_TEXT = native_file(__package__, "fit.inl")

EMPTY = 1e30
"""Corner of an empty box, which no ray hits: low = EMPTY, high = -EMPTY. It is finite, so that 0 * EMPTY is not NaN."""

RELATIVE_PADDING = 1e-5
"""Share of its extent by which a box is enlarged, against rounding."""

COORDINATE_PADDING = 1e-6
"""Share of its coordinates by which a box is enlarged: about 10 ulp of float32, against rounding."""

LEAF_FIELDS = 14
"""Numbers of each surfel in a leaf: centre (3), axis_u (3), axis_v (3), normal (3), opacity, squared support radius."""


@cache
def fit_kernels(dtype: torch.dtype) -> SimpleNamespace:
    """``leaves`` and ``nodes`` for a scalar type; all arrays are flat.

    ``corners``: low x, y, z and high x, y, z of the box around each node, then around each leaf. ``areas``: half the
    surface area of these boxes, float64. ``nodes`` processes the nodes before ``end`` from the last one backwards; the
    boxes of their children have to be computed before.
    """
    start_warp()
    flat, doubles = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.float64)
    numbers, kinds = wp.array(dtype=wp.int32), wp.array(dtype=wp.uint8)
    words = {
        "LEAF_FIELDS": str(LEAF_FIELDS), "WIDTH": str(WIDTH), "EMPTY": repr(EMPTY), "REGULAR": str(REGULAR),
        "RELATIVE_PADDING": repr(RELATIVE_PADDING), "COORDINATE_PADDING": repr(COORDINATE_PADDING),
    }  # fmt: skip
    leaf_text, node_text = (native_text(_TEXT[part], dtype, False, words) for part in ("fit_leaf", "fit_node"))

    @wp.func_native(leaf_text)
    def fit_leaf(
        leaf: wp.int32, nodes: wp.int32, order: numbers, centre: flat, axis_u: flat, axis_v: flat, normal: flat,
        opacity: flat, radius: flat, extent: flat, kind: kinds, leaves: flat, corners: flat,
        areas: doubles,
    ): ...  # fmt: skip

    @wp.func_native(node_text)
    def fit_node(
        node: wp.int32, nodes: wp.int32, leaves: wp.int32, children: numbers, boxes: flat, corners: flat,
        areas: doubles,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=UNFUSED)
    def fit_leaves(
        begin: wp.int32, nodes: wp.int32, order: numbers, centre: flat, axis_u: flat, axis_v: flat, normal: flat,
        opacity: flat, radius: flat, extent: flat, kind: kinds, leaves: flat, corners: flat,
        areas: doubles,
    ):  # fmt: skip
        fit_leaf(
            begin + wp.tid(), nodes, order, centre, axis_u, axis_v, normal, opacity, radius, extent, kind,
            leaves, corners, areas,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=UNFUSED)
    def fit_nodes(
        begin: wp.int32, end: wp.int32, nodes: wp.int32, leaves: wp.int32, children: numbers, boxes: flat,
        corners: flat, areas: doubles,
    ):  # fmt: skip
        fit_node(end - 1 - begin - wp.tid(), nodes, leaves, children, boxes, corners, areas)

    return SimpleNamespace(leaves=fit_leaves, nodes=fit_nodes)
