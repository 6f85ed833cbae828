"""Kernel of the surface-area heuristic: splits surfels into the leaves of an eight-wide tree, on one CPU thread.

The surfels of a node are split into parts, always the part with the largest box, until there are eight parts or no part
has more than eight surfels. A split is the best of BINS - 1 planes on each axis by sum(area * number of leaves) (Wald
2007; the number of leaves is rounded up, because testing eight surfels costs as much as testing one).
"""

from functools import cache

import warp as wp

from ..runtime import start_warp

BINS = 16
"""Bins on each axis, one more than planes that are tried; 32 measured the same cost within 1 %."""


@cache
def sah_kernel() -> wp.Kernel:
    """The kernel that builds a tree. Boxes are low x, y, z, high x, y, z in float32; float64 geometry is fitted
    later."""
    start_warp()
    bins = wp.constant(BINS)
    huge = wp.constant(wp.float32(1e30))
    table = wp.types.matrix(shape=(3 * BINS, 6), dtype=wp.float32)
    counts = wp.types.vector(3 * BINS, wp.int32)
    slots = wp.types.vector(8, wp.int32)
    areas = wp.types.vector(8, wp.float32)
    planes = wp.types.vector(BINS, wp.float32)
    six = wp.types.vector(6, wp.float32)

    @wp.func
    def half_area(box: six):
        x = wp.max(box[3] - box[0], wp.float32(0.0))
        y = wp.max(box[4] - box[1], wp.float32(0.0))
        z = wp.max(box[5] - box[2], wp.float32(0.0))
        return x * y + y * z + z * x

    @wp.func
    def nothing():
        return six(huge, huge, huge, -huge, -huge, -huge)

    @wp.func
    def joined(a: six, b: six):
        return six(
            wp.min(a[0], b[0]), wp.min(a[1], b[1]), wp.min(a[2], b[2]),
            wp.max(a[3], b[3]), wp.max(a[4], b[4]), wp.max(a[5], b[5]),
        )  # fmt: skip

    @wp.func
    def middle(box: six, axis: wp.int32):
        return wp.float32(0.5) * (box[axis] + box[axis + 3])

    @wp.func
    def leaves_of(count: wp.int32):
        return wp.float32((count + 7) / 8)

    @wp.func
    def split(boxes: wp.array(dtype=six), order: wp.array(dtype=wp.int32), begin: wp.int32, end: wp.int32):
        """Reorder the segment into two consecutive parts; returns the start of the second."""
        low = wp.vec3(huge, huge, huge)
        high = -low
        for index in range(begin, end):
            box = boxes[order[index]]
            point = wp.vec3(middle(box, 0), middle(box, 1), middle(box, 2))
            low = wp.min(low, point)
            high = wp.max(high, point)
        scale = wp.vec3()
        for axis in range(3):
            if high[axis] > low[axis]:
                scale[axis] = wp.float32(bins) * wp.float32(0.9999) / (high[axis] - low[axis])
        bounds = table()
        filled = counts()
        for entry in range(3 * bins):
            for side in range(3):
                bounds[entry, side] = huge
                bounds[entry, side + 3] = -huge
        for index in range(begin, end):
            box = boxes[order[index]]
            for axis in range(3):
                entry = axis * bins + wp.int32((middle(box, axis) - low[axis]) * scale[axis])
                filled[entry] += 1
                for side in range(3):
                    bounds[entry, side] = wp.min(bounds[entry, side], box[side])
                    bounds[entry, side + 3] = wp.max(bounds[entry, side + 3], box[side + 3])
        best = huge
        best_axis = wp.int32(-1)
        best_plane = wp.int32(0)
        behind = planes()
        for axis in range(3):
            right = nothing()
            held = wp.int32(0)
            for step in range(1, bins):
                plane = bins - step
                entry = axis * bins + plane
                for side in range(3):
                    right[side] = wp.min(right[side], bounds[entry, side])
                    right[side + 3] = wp.max(right[side + 3], bounds[entry, side + 3])
                held += filled[entry]
                behind[plane] = huge
                if held > 0:
                    behind[plane] = half_area(right) * leaves_of(held)
            left = nothing()
            held = wp.int32(0)
            for plane in range(1, bins):
                entry = axis * bins + plane - 1
                for side in range(3):
                    left[side] = wp.min(left[side], bounds[entry, side])
                    left[side + 3] = wp.max(left[side + 3], bounds[entry, side + 3])
                held += filled[entry]
                if held > 0 and behind[plane] < huge:
                    cost = half_area(left) * leaves_of(held) + behind[plane]
                    if cost < best:
                        best = cost
                        best_axis = axis
                        best_plane = plane
        if best_axis < 0:
            return (begin + end) / 2
        first = begin
        last = end - 1
        while first <= last:
            surfel = order[first]
            found = wp.int32((middle(boxes[surfel], best_axis) - low[best_axis]) * scale[best_axis])
            if found < best_plane:
                first += 1
            else:
                order[first] = order[last]
                order[last] = surfel
                last -= 1
        return first

    @wp.func
    def area_of(boxes: wp.array(dtype=six), order: wp.array(dtype=wp.int32), begin: wp.int32, end: wp.int32):
        box = nothing()
        for index in range(begin, end):
            box = joined(box, boxes[order[index]])
        return half_area(box)

    @wp.kernel(enable_backward=False, module="unique", module_options={"max_unroll": 3})
    def build(
        first: wp.int32,
        boxes: wp.array(dtype=six),
        order: wp.array(dtype=wp.int32),
        segment: wp.array(dtype=wp.int32),
        child: wp.array(dtype=wp.int32),
        leaf: wp.array(dtype=wp.int32),
        level_end: wp.array(dtype=wp.int32),
        made: wp.array(dtype=wp.int32),
    ):
        """Build nodes level by level; ``segment``: range of ``order`` of each node that is not yet split.

        ``child``, ``leaf``: eight entries of each node and of each leaf. ``made``: numbers of nodes, leaves and levels.
        A tree with more levels than ``level_end`` has entries is left unfinished, and ``made[0]`` is zero.
        """
        nodes = wp.int32(1)
        leaves = wp.int32(0)
        levels = wp.int32(0)
        node = wp.int32(0)
        segment[0] = 0
        segment[1] = order.shape[0]
        while node < nodes:
            if levels == level_end.shape[0]:
                made[0] = 0
                return
            last = nodes
            while node < last:
                begin = slots()
                end = slots()
                area = areas()
                parts = wp.int32(1)
                begin[0] = segment[2 * node]
                end[0] = segment[2 * node + 1]
                area[0] = huge
                due = wp.int32(0)
                while due >= 0 and parts < 8:
                    due = wp.int32(-1)
                    largest = wp.float32(-1.0)
                    for part in range(parts):
                        if end[part] - begin[part] > 8 and area[part] > largest:
                            largest = area[part]
                            due = part
                    if due >= 0:
                        cut = split(boxes, order, begin[due], end[due])
                        begin[parts] = cut
                        end[parts] = end[due]
                        end[due] = cut
                        area[due] = area_of(boxes, order, begin[due], cut)
                        area[parts] = area_of(boxes, order, cut, end[parts])
                        parts += 1
                for part in range(parts):
                    if end[part] - begin[part] > 8:
                        segment[2 * nodes] = begin[part]
                        segment[2 * nodes + 1] = end[part]
                        child[8 * node + part] = nodes
                        nodes += 1
                    else:
                        child[8 * node + part] = -1 - leaves
                        for index in range(begin[part], end[part]):
                            leaf[8 * leaves + index - begin[part]] = order[index]
                        leaves += 1
                node += 1
            level_end[levels] = last
            levels += 1
        made[0] = nodes
        made[1] = leaves
        made[2] = levels

    return build
