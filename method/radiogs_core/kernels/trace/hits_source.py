"""The kernels that find the hits of a ray: gather them in order, then pack the rays' lists into one.

Gathering is one native snippet of plain loops over eight lanes, which the CPU compiler turns into vector code
(a pure Warp version of the same traversal measured a third of its speed) and CUDA compiles as it is.
"""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..lanes import BELL, VECTORS, bell_words
from ..native_text import native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA

BUFFER = 32
"""Hits gathered in one round; longer buffers measured faster than restarting more often."""

STACK = 96
"""Entries of the traversal stack: 7 (depth - 1) + 1 are needed, so 96 allows 14 levels (8^14 leaves)."""

_GATHER = (
    """
#if ON_CUDA
    #define LOWEST_BYTE(bits) ((__ffsll(bits) - 1) >> 3)
    #define FETCH(address)
#else
    #define LOWEST_BYTE(bits) (__builtin_ctzll(bits) >> 3)
    #define FETCH(address) __builtin_prefetch(address)
#endif
    constexpr int LANES = 8;
"""
    + VECTORS
    + BELL
    + """
    const SCALAR ox = origin[0], oy = origin[1], oz = origin[2];
    const SCALAR dx = direction[0], dy = direction[1], dz = direction[2];
    const SCALAR huge = SCALAR(1e30);
    const SCALAR ix = dx != SCALAR(0) ? SCALAR(1) / dx : huge;
    const SCALAR iy = dy != SCALAR(0) ? SCALAR(1) / dy : huge;
    const SCALAR iz = dz != SCALAR(0) ? SCALAR(1) / dz : huge;
    const int nx = ix >= SCALAR(0) ? 0 : 24, ny = iy >= SCALAR(0) ? 8 : 32, nz = iz >= SCALAR(0) ? 16 : 40;
    const int fx = 24 - nx, fy = 40 - ny, fz = 56 - nz;
    SCALAR* hit_t = hits_t.data + (long long)slot * BUFFER;
    int* hit_id = hits_id.data + (long long)slot * BUFFER;
    SCALAR* hit_alpha = hits_alpha.data + (long long)slot * BUFFER;
    SCALAR left[BUFFER + 1];
    SCALAR limit = huge;
    int found = 0, nodes = 0, leaf_count = 0, top = 0, closed = 0, node = 0;
    int stack_node[STACK];
    SCALAR stack_t[STACK];
    left[0] = start_rest;
    for (;;) {
        if (node >= 0) {
            ++nodes;
            const SCALAR* box = boxes.data + (long long)node * 48;
            const int* child = children.data + (long long)node * 8;
            SCALAR enter[8];
            unsigned char flag[8];
            for (int c = 0; c < 8; ++c) {
                const SCALAR ax = (box[nx + c] - ox) * ix, bx = (box[fx + c] - ox) * ix;
                const SCALAR ay = (box[ny + c] - oy) * iy, by = (box[fy + c] - oy) * iy;
                const SCALAR az = (box[nz + c] - oz) * iz, bz = (box[fz + c] - oz) * iz;
                SCALAR near_ = ax > ay ? ax : ay;
                near_ = near_ > az ? near_ : az;
                near_ = near_ > start_t ? near_ : start_t;
                SCALAR far_ = bx < by ? bx : by;
                far_ = far_ < bz ? far_ : bz;
                far_ *= SCALAR(1.0000005);
                far_ = far_ < limit ? far_ : limit;
                enter[c] = near_;
                flag[c] = near_ <= far_;
            }
            unsigned long long bits;
            memcpy(&bits, flag, 8);
            if (bits) {
                // The nearest child stays in hand, the others go on the stack, the farthest deepest.
                int c = LOWEST_BYTE(bits);
                bits &= bits - 1;
                int next = child[c];
                SCALAR next_t = enter[c];
                const int begin = top;
                while (bits) {
                    c = LOWEST_BYTE(bits);
                    bits &= bits - 1;
                    int other = child[c];
                    SCALAR other_t = enter[c];
                    if (other_t < next_t) {
                        const int swap = next;
                        next = other;
                        other = swap;
                        const SCALAR swap_t = next_t;
                        next_t = other_t;
                        other_t = swap_t;
                    }
                    int at = top++;
                    while (at > begin && stack_t[at - 1] < other_t) {
                        stack_t[at] = stack_t[at - 1];
                        stack_node[at] = stack_node[at - 1];
                        --at;
                    }
                    stack_t[at] = other_t;
                    stack_node[at] = other;
                    // What waits will be read from beyond the second-level cache (measured: 7 %).
                    if (other >= 0) {
                        FETCH(boxes.data + (long long)other * 48);
                        FETCH(boxes.data + (long long)other * 48 + 16);
                        FETCH(boxes.data + (long long)other * 48 + 32);
                    } else {
                        const SCALAR* line = leaves.data + (long long)(-1 - other) * 112;
                        for (int k = 0; k < 7; ++k) FETCH(line + 16 * k);
                    }
                }
                node = next;
                continue;
            }
        } else {
            ++leaf_count;
            const int leaf = -1 - node;
            const SCALAR* f = leaves.data + (long long)leaf * 112;
            SCALAR depth[8], square[8];
            unsigned char flag[8];
            for (int c = 0; c < 8; ++c) {
                const SCALAR px = f[c] - ox, py = f[8 + c] - oy, pz = f[16 + c] - oz;
                const SCALAR slope = f[72 + c] * dx + f[80 + c] * dy + f[88 + c] * dz;
                const SCALAR reach = f[72 + c] * px + f[80 + c] * py + f[88 + c] * pz;
                const SCALAR t = reach / (slope < SCALAR(0) || slope > SCALAR(0) ? slope : SCALAR(-1));
                const SCALAR x = t * dx - px, y = t * dy - py, z = t * dz - pz;
                const SCALAR u = f[24 + c] * x + f[32 + c] * y + f[40 + c] * z;
                const SCALAR v = f[48 + c] * x + f[56 + c] * y + f[64 + c] * z;
                depth[c] = t;
                square[c] = u * u + v * v;
                const bool met = (slope < SCALAR(0)) | ((slope > SCALAR(0)) & (t >= back_t));
                flag[c] = met & (square[c] <= f[104 + c]) & (t >= start_t) & (t <= limit);
            }
            unsigned long long bits;
            memcpy(&bits, flag, 8);
#if !ON_CUDA
            Lanes bells;
            memcpy(&bells, square, sizeof(bells));
            if (bits) bells = bell(bells);
#endif
            while (bits) {
                const int c = LOWEST_BYTE(bits);
                bits &= bits - 1;
                const SCALAR t = depth[c];
                const int id = order.data[leaf * 8 + c];
                if (t == start_t && id <= start_id) continue;
                if (t > limit) continue;
                int at = found;
                while (at > 0 && (hit_t[at - 1] > t || (hit_t[at - 1] == t && hit_id[at - 1] > id))) --at;
                if (at >= BUFFER || (closed && at >= found)) continue;
                if (found < BUFFER) ++found;
                for (int j = found - 1; j > at; --j) {
                    hit_t[j] = hit_t[j - 1];
                    hit_id[j] = hit_id[j - 1];
                    hit_alpha[j] = hit_alpha[j - 1];
                }
#if ON_CUDA
                const SCALAR alpha = f[96 + c] * bell(square[c]);
#else
                const SCALAR alpha = f[96 + c] * bells[c];
#endif
                hit_t[at] = t;
                hit_id[at] = id;
                hit_alpha[at] = alpha < SCALAR(MAX_ALPHA) ? alpha : SCALAR(MAX_ALPHA);
                closed = 0;
                for (int j = at; j < found; ++j) {
                    left[j + 1] = left[j] * (SCALAR(1) - hit_alpha[j]);
                    if (left[j + 1] < stop) {
                        found = j + 1;
                        closed = 1;
                    }
                }
                if (closed || found == BUFFER) limit = hit_t[found - 1];
            }
        }
        do {
            if (top == 0) goto done;
            --top;
        } while (stack_t[top] > limit);
        node = stack_node[top];
    }
done:
    found_out.data[slot] = found;
    rest_out.data[slot] = left[found];
    nodes_out.data[slot] = nodes;
    leaves_out.data[slot] = leaf_count;
"""
)


@cache
def hit_kernels(dtype: torch.dtype, on_cuda: bool) -> SimpleNamespace:
    """Kernels ``code``, ``gather`` and ``pack`` for float32 or float64, and the vector type that they take."""
    start_warp()
    scalar = scalar_type(dtype)
    vector = wp.types.vector(3, scalar)
    words = {"BUFFER": str(BUFFER), "STACK": str(STACK), "MAX_ALPHA": str(MAX_ALPHA), **bell_words(dtype)}

    @wp.func
    def spread(bits: wp.int32):
        """Two zeros between any two of nine bits."""
        bits = (bits | (bits << 16)) & 0x030000FF
        bits = (bits | (bits << 8)) & 0x0300F00F
        bits = (bits | (bits << 4)) & 0x030C30C3
        return (bits | (bits << 2)) & 0x09249249

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def code(
        first: wp.int32,
        origin: wp.array(dtype=vector),
        direction: wp.array(dtype=vector),
        low: vector,
        cells: scalar,
        out: wp.array(dtype=wp.int32),
    ):
        ray = first + wp.tid()
        place = (origin[ray] - low) * cells
        towards = direction[ray]
        found = wp.int32(0)
        for axis in range(3):
            cell = wp.clamp(wp.int32(place[axis]), 0, 511)
            found += spread(cell) << axis
            if towards[axis] > scalar(0.0):
                found += 1 << (27 + axis)
        out[ray] = found

    @wp.func_native(native_text(_GATHER, dtype, on_cuda, words))
    def gather_hits(
        slot: wp.int32,
        origin: vector,
        direction: vector,
        start_t: scalar,
        start_id: wp.int32,
        start_rest: scalar,
        back_t: scalar,
        stop: scalar,
        boxes: wp.array(dtype=scalar),
        children: wp.array(dtype=wp.int32),
        leaves: wp.array(dtype=scalar),
        order: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        hits_alpha: wp.array(dtype=scalar),
        found_out: wp.array(dtype=wp.int32),
        rest_out: wp.array(dtype=scalar),
        nodes_out: wp.array(dtype=wp.int32),
        leaves_out: wp.array(dtype=wp.int32),
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def gather(
        first: wp.int32,
        rays: wp.array(dtype=wp.int32),
        origin: wp.array(dtype=vector),
        direction: wp.array(dtype=vector),
        start_t: wp.array(dtype=scalar),
        start_id: wp.array(dtype=wp.int32),
        start_rest: wp.array(dtype=scalar),
        back_t: wp.array(dtype=scalar),
        stop: scalar,
        boxes: wp.array(dtype=scalar),
        children: wp.array(dtype=wp.int32),
        leaves: wp.array(dtype=scalar),
        order: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        hits_alpha: wp.array(dtype=scalar),
        found: wp.array(dtype=wp.int32),
        rest: wp.array(dtype=scalar),
        node_visits: wp.array(dtype=wp.int32),
        leaf_visits: wp.array(dtype=wp.int32),
    ):
        slot = first + wp.tid()
        ray = rays[slot]
        gather_hits(
            slot, origin[ray], direction[ray], start_t[slot], start_id[slot], start_rest[slot], back_t[ray], stop,
            boxes, children, leaves, order, hits_t, hits_id, hits_alpha, found, rest, node_visits, leaf_visits,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def pack(
        first: wp.int32,
        found: wp.array(dtype=wp.int32),
        begin: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        hits_alpha: wp.array(dtype=scalar),
        depth: wp.array(dtype=scalar),
        surfel: wp.array(dtype=wp.int32),
        alpha: wp.array(dtype=scalar),
    ):
        slot = first + wp.tid()
        source = slot * wp.static(BUFFER)
        target = begin[slot]
        for step in range(found[slot]):
            depth[target + step] = hits_t[source + step]
            surfel[target + step] = hits_id[source + step]
            alpha[target + step] = hits_alpha[source + step]

    return SimpleNamespace(code=code, gather=gather, pack=pack, vector=vector)
