"""The kernels that fit a tree to its surfels: one item a leaf, then one item a node, deepest nodes first."""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import UNFUSED, scalar_type, start_warp
from ..surfel.support_source import MET
from .topology import WIDTH

EMPTY = 1e30
"""Corner of a box that no ray meets: low = EMPTY, high = -EMPTY. Finite, so that 0 * EMPTY stays a number."""

RELATIVE_PADDING = 1e-5
COORDINATE_PADDING = 1e-6
"""Boxes grow by these shares of their extent and of their coordinates: about 10 ulp of float32, against rounding."""

LEAF_FIELDS = 14
"""Per surfel of a leaf: centre (3), axis_u (3), axis_v (3), normal (3), opacity, squared support radius."""

_ENCLOSE = """
    // The box around boxes that stand WIDTH abreast, and half of its area.
    auto enclose = [](const SCALAR* sides, SCALAR* whole) -> double {
        for (int side = 0; side < 6; ++side) {
            SCALAR best = sides[side * WIDTH];
            for (int lane = 1; lane < WIDTH; ++lane) {
                const SCALAR other = sides[side * WIDTH + lane];
                if (side < 3 ? other < best : other > best) best = other;
            }
            whole[side] = best;
        }
        double length[3];
        for (int k = 0; k < 3; ++k) {
            const SCALAR signed_length = whole[3 + k] - whole[k];
            length[k] = signed_length > SCALAR(0) ? signed_length : SCALAR(0);
        }
        return length[0] * length[1] + length[1] * length[2] + length[2] * length[0];
    };
"""

_FIT_LEAF = """
    const SCALAR* vectors[4] = {centre.data, axis_u.data, axis_v.data, normal.data};
    SCALAR* to = leaves.data + (long long)leaf * LEAF_FIELDS * WIDTH;
    SCALAR sides[6 * WIDTH];
    for (int lane = 0; lane < WIDTH; ++lane) {
        const long long surfel = order.data[(long long)leaf * WIDTH + lane];
        if (surfel < 0 || kind.data[surfel] < MET) {
            for (int field = 0; field < LEAF_FIELDS; ++field) to[field * WIDTH + lane] = SCALAR(0);
            for (int side = 0; side < 6; ++side) sides[side * WIDTH + lane] = SCALAR(side < 3 ? EMPTY : -EMPTY);
            continue;
        }
        for (int vector = 0; vector < 4; ++vector)
            for (int k = 0; k < 3; ++k) to[(3 * vector + k) * WIDTH + lane] = vectors[vector][3 * surfel + k];
        to[12 * WIDTH + lane] = opacity.data[surfel];
        to[13 * WIDTH + lane] = radius.data[surfel] * radius.data[surfel];
        const SCALAR *middle = centre.data + 3 * surfel, *half = extent.data + 3 * surfel;
        const SCALAR wider = half[0] > half[1] ? half[0] : half[1], widest = wider > half[2] ? wider : half[2];
        for (int k = 0; k < 3; ++k) {
            const SCALAR size = middle[k] < SCALAR(0) ? -middle[k] : middle[k];
            const SCALAR padded = half[k] + SCALAR(RELATIVE_PADDING) * widest + SCALAR(COORDINATE_PADDING) * size;
            sides[k * WIDTH + lane] = middle[k] - padded;
            sides[(3 + k) * WIDTH + lane] = middle[k] + padded;
        }
    }
    const long long place = nodes + (long long)leaf;
    areas.data[place] = enclose(sides, corners.data + 6 * place);
"""

_FIT_NODE = """
    SCALAR* sides = boxes.data + 6LL * WIDTH * node;
    for (int lane = 0; lane < WIDTH; ++lane) {
        const int child = children.data[(long long)node * WIDTH + lane];
        const long long place = child >= 0 ? child : nodes - 1LL - child;
        const bool absent = place == nodes + leaves;
        for (int side = 0; side < 6; ++side)
            sides[side * WIDTH + lane] =
                absent ? SCALAR(side < 3 ? EMPTY : -EMPTY) : corners.data[6 * place + side];
    }
    areas.data[node] = enclose(sides, corners.data + 6LL * node);
"""


@cache
def fit_kernels(dtype: torch.dtype) -> SimpleNamespace:
    """``leaves`` and ``nodes`` for a scalar type; all arrays are flat.

    ``corners``: low x, y, z and high x, y, z of the box around each node, then around each leaf; ``areas``: half of
    those boxes' areas, in float64. ``nodes`` takes the nodes before ``end`` from the last one backwards; the boxes of
    their children must be there or come before.
    """
    start_warp()
    flat, doubles = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.float64)
    numbers, kinds = wp.array(dtype=wp.int32), wp.array(dtype=wp.uint8)
    words = {
        "LEAF_FIELDS": str(LEAF_FIELDS), "WIDTH": str(WIDTH), "EMPTY": repr(EMPTY), "MET": str(MET),
        "RELATIVE_PADDING": repr(RELATIVE_PADDING), "COORDINATE_PADDING": repr(COORDINATE_PADDING),
    }  # fmt: skip
    leaf_text, node_text = (native_text(_ENCLOSE + text, dtype, False, words) for text in (_FIT_LEAF, _FIT_NODE))

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
