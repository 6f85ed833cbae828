"""The kernels of normals from a depth map's points: one item a pixel, forward and backward.

The backward pass has two kernels: ``pull`` takes each normal's gradient to its two steps, ``gather`` takes the steps'
gradients to the points at their ends, each pixel from itself and its four neighbours.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_text
from ..runtime import ITEMWISE, scalar_type, start_warp

NO_SECOND_NEIGHBOUR = 1e6
"""Bend of a side that has one neighbour only: it is taken where the other side has none."""

NO_NEIGHBOUR = 1e30
"""Bend of a side without a neighbour: it is not taken."""

# Along each axis, the side on which inverse depth is more nearly linear; 0 where neither has a neighbour.
_FORWARD = """
    const int column = item % width, row = item / width;
    const int along[2] = {1, width}, at[2] = {column, row}, size[2] = {width, height};
    SCALAR* normal = out.data + 3LL * item;
    for (int c = 0; c < 3; ++c) normal[c] = SCALAR(0);
    sides.data[2LL * item] = 0;
    sides.data[2LL * item + 1] = 0;
    if (!solid.data[item]) return;
    const SCALAR here = SCALAR(1) / depth.data[item];
    int side[2] = {0, 0};
    for (int axis = 0; axis < 2; ++axis) {
        SCALAR bends[2];
        for (int k = 0; k < 2; ++k) {
            const int sign = k == 0 ? 1 : -1;
            const int next = at[axis] + sign, second = next + sign;
            bends[k] = SCALAR(ABSENT);
            if (next < 0 || next >= size[axis] || !solid.data[item + sign * along[axis]]) continue;
            bends[k] = SCALAR(ALONE);
            const int further = item + 2 * sign * along[axis];
            if (second < 0 || second >= size[axis] || !solid.data[further]) continue;
            const SCALAR bend = here - SCALAR(2) / depth.data[item + sign * along[axis]]
                + SCALAR(1) / depth.data[further];
            const SCALAR size_of_bend = bend < SCALAR(0) ? -bend : bend;
            // A bend that is no number is as none.
            bends[k] = size_of_bend < SCALAR(ABSENT) ? size_of_bend : SCALAR(ABSENT);
        }
        if (bends[0] == SCALAR(ABSENT) && bends[1] == SCALAR(ABSENT)) return;
        side[axis] = bends[0] <= bends[1] ? 1 : -1;
    }
    const SCALAR* point = points.data + 3LL * item;
    SCALAR step[2][3];
    for (int axis = 0; axis < 2; ++axis)
        for (int c = 0; c < 3; ++c)
            step[axis][c] = side[axis] * (point[3LL * side[axis] * along[axis] + c] - point[c]);
    // Down times across: x right times y down points away from the camera.
    SCALAR cross[3], square = SCALAR(0), facing = SCALAR(0);
    for (int c = 0; c < 3; ++c) {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        cross[c] = step[1][d] * step[0][e] - step[1][e] * step[0][d];
        square += cross[c] * cross[c];
        facing += cross[c] * (toward.data[c] - point[c]);
    }
    if (!(square > SCALAR(0))) return;
    const SCALAR length = SCALAR(sqrt(square)), sign = facing < SCALAR(0) ? SCALAR(-1) : SCALAR(1);
    for (int c = 0; c < 3; ++c) normal[c] = sign * cross[c] / length;
    for (int axis = 0; axis < 2; ++axis) sides.data[2LL * item + axis] = side[axis];
"""

_PULL = """
    SCALAR* to = steps.data + 6LL * item;
    for (int k = 0; k < 6; ++k) to[k] = SCALAR(0);
    const int side[2] = {sides.data[2LL * item], sides.data[2LL * item + 1]};
    if (side[0] == 0) return;
    const int along[2] = {1, width};
    const SCALAR *point = points.data + 3LL * item, *n = normal.data + 3LL * item, *from = given.data + 3LL * item;
    SCALAR step[2][3], cross[3], square = SCALAR(0), sign = SCALAR(0), radial = SCALAR(0);
    for (int axis = 0; axis < 2; ++axis)
        for (int c = 0; c < 3; ++c)
            step[axis][c] = side[axis] * (point[3LL * side[axis] * along[axis] + c] - point[c]);
    for (int c = 0; c < 3; ++c) {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        cross[c] = step[1][d] * step[0][e] - step[1][e] * step[0][d];
        square += cross[c] * cross[c];
        sign += cross[c] * n[c];
        radial += n[c] * from[c];
    }
    const SCALAR scale = (sign < SCALAR(0) ? SCALAR(-1) : SCALAR(1)) / SCALAR(sqrt(square));
    SCALAR pull[3];
    for (int c = 0; c < 3; ++c) pull[c] = scale * (from[c] - radial * n[c]);
    for (int c = 0; c < 3; ++c) {
        const int d = (c + 1) % 3, e = (c + 2) % 3;
        to[c] = pull[d] * step[1][e] - pull[e] * step[1][d];
        to[3 + c] = step[0][d] * pull[e] - step[0][e] * pull[d];
    }
"""

_GATHER = """
    const int column = item % width, row = item / width;
    const int along[2] = {1, width}, at[2] = {column, row}, size[2] = {width, height};
    SCALAR* to = out.data + 3LL * item;
    for (int c = 0; c < 3; ++c) to[c] = SCALAR(0);
    for (int axis = 0; axis < 2; ++axis) {
        const int own = sides.data[2LL * item + axis];
        for (int c = 0; c < 3; ++c) to[c] -= own * steps.data[6LL * item + 3 * axis + c];
        for (int sign = -1; sign <= 1; sign += 2) {
            const int other = at[axis] - sign;
            const long long from = item - (long long)sign * along[axis];
            if (other < 0 || other >= size[axis] || sides.data[2 * from + axis] != sign) continue;
            for (int c = 0; c < 3; ++c) to[c] += sign * steps.data[6 * from + 3 * axis + c];
        }
    }
"""


@cache
def normal_kernels(dtype: torch.dtype) -> Any:
    """``forward``, ``pull`` and ``gather`` for a scalar type; all arrays are flat.

    ``sides``: of each pixel, the sides along x and y that were taken (1 or -1), 0 where it has no normal. ``steps``:
    gradients of the steps along x and y.
    """
    start_warp()
    flat, bytes_, signs = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.uint8), wp.array(dtype=wp.int8)
    words = {"ABSENT": repr(NO_NEIGHBOUR), "ALONE": repr(NO_SECOND_NEIGHBOUR)}
    forward_text, pull_text, gather_text = (
        native_text(text, dtype, False, words) for text in (_FORWARD, _PULL, _GATHER)
    )

    @wp.func_native(forward_text)
    def normal_at(
        item: wp.int32,
        height: wp.int32,
        width: wp.int32,
        points: flat,
        depth: flat,
        solid: bytes_,
        toward: flat,
        out: flat,
        sides: signs,
    ): ...

    @wp.func_native(pull_text)
    def pull_steps(
        item: wp.int32, width: wp.int32, points: flat, normal: flat, sides: signs, given: flat, steps: flat
    ): ...

    @wp.func_native(gather_text)
    def gather_ends(item: wp.int32, height: wp.int32, width: wp.int32, sides: signs, steps: flat, out: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32,
        height: wp.int32,
        width: wp.int32,
        points: flat,
        depth: flat,
        solid: bytes_,
        toward: flat,
        out: flat,
        sides: signs,
    ):
        normal_at(begin + wp.tid(), height, width, points, depth, solid, toward, out, sides)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def pull(begin: wp.int32, width: wp.int32, points: flat, normal: flat, sides: signs, given: flat, steps: flat):
        pull_steps(begin + wp.tid(), width, points, normal, sides, given, steps)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def gather(begin: wp.int32, height: wp.int32, width: wp.int32, sides: signs, steps: flat, out: flat):
        gather_ends(begin + wp.tid(), height, width, sides, steps, out)

    return SimpleNamespace(forward=forward, pull=pull, gather=gather)
