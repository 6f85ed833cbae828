"""The tracing kernels: gather the hits of a ray in order, then blend them, forward and backward.

Gathering is one native snippet of plain loops over eight lanes, which the CPU compiler turns into vector code
(a pure Warp version of the same traversal measured a third of its speed) and CUDA compiles as it is. The hits of a
ray are kept as a list, so the backward pass does not traverse again.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from .geometry import MAX_ALPHA
from .runtime import scalar_type, start_warp

BUFFER = 32
"""Hits gathered in one round; longer buffers measured faster than restarting more often."""

STACK = 96
"""Entries of the traversal stack: 7 (depth - 1) + 1 are needed, so 96 allows 14 levels (8^14 leaves)."""

OPTIONS = {"cpu_compiler_flags": "-march=native -ffp-contract=fast"}

_GATHER = """
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
    SCALAR rest[BUFFER];
    SCALAR limit = huge;
    int found = 0, visits = 0, top = 1, closed = 0;
    int stack_node[STACK];
    SCALAR stack_t[STACK];
    stack_node[0] = 0;
    stack_t[0] = SCALAR(0);
    while (top > 0) {
        --top;
        if (stack_t[top] > limit) continue;
        const int node = stack_node[top];
        ++visits;
        if (node >= 0) {
            const SCALAR* box = boxes.data + (long long)node * 48;
            SCALAR enter[8], leave[8];
            for (int c = 0; c < 8; ++c) {
                const SCALAR ax = (box[nx + c] - ox) * ix, bx = (box[fx + c] - ox) * ix;
                const SCALAR ay = (box[ny + c] - oy) * iy, by = (box[fy + c] - oy) * iy;
                const SCALAR az = (box[nz + c] - oz) * iz, bz = (box[fz + c] - oz) * iz;
                SCALAR near_ = ax > ay ? ax : ay;
                near_ = near_ > az ? near_ : az;
                SCALAR far_ = bx < by ? bx : by;
                far_ = far_ < bz ? far_ : bz;
                enter[c] = near_;
                leave[c] = far_ * SCALAR(1.0000005);
            }
            const int base = first_child.data[node];
            const int begin = top;
            for (int c = 0; c < 8; ++c) {
                if (enter[c] <= leave[c] && leave[c] >= start_t && enter[c] <= limit) {
                    int at = top++;
                    while (at > begin && stack_t[at - 1] < enter[c]) {
                        stack_t[at] = stack_t[at - 1];
                        stack_node[at] = stack_node[at - 1];
                        --at;
                    }
                    stack_t[at] = enter[c];
                    stack_node[at] = base >= 0 ? base + c : base - c;
                }
            }
        } else {
            const int leaf = -1 - node;
            const SCALAR* f = leaves.data + (long long)leaf * 112;
            SCALAR depth[8], square[8];
            int met[8];
            for (int c = 0; c < 8; ++c) {
                const SCALAR px = f[c] - ox, py = f[8 + c] - oy, pz = f[16 + c] - oz;
                const SCALAR slope = f[72 + c] * dx + f[80 + c] * dy + f[88 + c] * dz;
                const SCALAR reach = f[72 + c] * px + f[80 + c] * py + f[88 + c] * pz;
                const SCALAR t = reach / (slope < SCALAR(0) ? slope : SCALAR(-1));
                const SCALAR x = t * dx - px, y = t * dy - py, z = t * dz - pz;
                const SCALAR u = f[24 + c] * x + f[32 + c] * y + f[40 + c] * z;
                const SCALAR v = f[48 + c] * x + f[56 + c] * y + f[64 + c] * z;
                depth[c] = t;
                square[c] = u * u + v * v;
                met[c] = (slope < SCALAR(0)) & (square[c] <= f[104 + c]) & (t >= start_t) & (t <= limit);
            }
            for (int c = 0; c < 8; ++c) {
                if (!met[c]) continue;
                const SCALAR t = depth[c];
                const int id = order.data[leaf * 8 + c];
                if (t == start_t && id <= start_id) continue;
                if (t > limit) continue;
                int at = found;
                while (at > 0 && (hit_t[at - 1] > t || (hit_t[at - 1] == t && hit_id[at - 1] > id))) --at;
                if (at >= BUFFER) continue;
                if (closed && at >= found) continue;
                const int last = found < BUFFER ? found : BUFFER - 1;
                for (int j = last; j > at; --j) {
                    hit_t[j] = hit_t[j - 1];
                    hit_id[j] = hit_id[j - 1];
                    rest[j] = rest[j - 1];
                }
                SCALAR alpha = f[96 + c] * SCALAR(exp(SCALAR(-0.5) * square[c]));
                alpha = alpha < SCALAR(MAX_ALPHA) ? alpha : SCALAR(MAX_ALPHA);
                hit_t[at] = t;
                hit_id[at] = id;
                rest[at] = SCALAR(1) - alpha;
                if (found < BUFFER) ++found;
                SCALAR left = start_rest;
                closed = 0;
                for (int j = 0; j < found; ++j) {
                    left *= rest[j];
                    if (left < stop) {
                        found = j + 1;
                        closed = 1;
                        break;
                    }
                }
                if (closed || found == BUFFER) limit = hit_t[found - 1];
            }
        }
    }
    SCALAR left = start_rest;
    for (int j = 0; j < found; ++j) left *= rest[j];
    found_out.data[slot] = found;
    rest_out.data[slot] = left;
    visits_out.data[slot] = visits;
"""


@cache
def trace_kernels(dtype: torch.dtype, channels: int) -> Any:
    """``gather``, ``forward`` and ``backward`` for a scalar type and a number of feature channels (at least one)."""
    start_warp()
    scalar = scalar_type(dtype)
    vector = wp.types.vector(3, scalar)
    feature = wp.types.vector(channels, scalar)
    splat = wp.types.vector(13, scalar)
    basis_type = wp.types.vector(16, scalar)
    ceiling = wp.constant(scalar(MAX_ALPHA))
    name = "wp::float32" if dtype == torch.float32 else "wp::float64"
    snippet = _GATHER
    for word, text in (("SCALAR", name), ("BUFFER", str(BUFFER)), ("STACK", str(STACK)), ("MAX_ALPHA", str(MAX_ALPHA))):
        snippet = snippet.replace(word, text)

    @wp.func_native(snippet)
    def gather_hits(
        slot: wp.int32,
        origin: vector,
        direction: vector,
        start_t: scalar,
        start_id: wp.int32,
        start_rest: scalar,
        stop: scalar,
        boxes: wp.array(dtype=scalar),
        first_child: wp.array(dtype=wp.int32),
        leaves: wp.array(dtype=scalar),
        order: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        found_out: wp.array(dtype=wp.int32),
        rest_out: wp.array(dtype=scalar),
        visits_out: wp.array(dtype=wp.int32),
    ): ...

    @wp.struct
    class Hits:
        origin: wp.array(dtype=vector)
        direction: wp.array(dtype=vector)
        begin: wp.array(dtype=wp.int32)
        surfel: wp.array(dtype=wp.int32)
        surface: wp.array(dtype=splat)
        sh: wp.array2d(dtype=vector)
        features: wp.array(dtype=feature)

    @wp.struct
    class Hit:
        depth: scalar
        inverse: scalar
        u: scalar
        v: scalar
        bell: scalar
        full: scalar
        alpha: scalar
        offset: vector

    @wp.func
    def part(record: splat, start: wp.int32):
        return vector(record[start], record[start + 1], record[start + 2])

    @wp.func
    def basis_at(d: vector):
        x = d[0]
        y = d[1]
        z = d[2]
        xx = x * x
        yy = y * y
        zz = z * z
        value = basis_type()
        value[0] = scalar(0.28209479177387814)
        value[1] = scalar(-0.4886025119029199) * y
        value[2] = scalar(0.4886025119029199) * z
        value[3] = scalar(-0.4886025119029199) * x
        value[4] = scalar(1.0925484305920792) * x * y
        value[5] = scalar(-1.0925484305920792) * y * z
        value[6] = scalar(0.31539156525252005) * (scalar(2.0) * zz - xx - yy)
        value[7] = scalar(-1.0925484305920792) * x * z
        value[8] = scalar(0.5462742152960396) * (xx - yy)
        value[9] = scalar(-0.5900435899266435) * y * (scalar(3.0) * xx - yy)
        value[10] = scalar(2.890611442640554) * x * y * z
        value[11] = scalar(-0.4570457994644658) * y * (scalar(4.0) * zz - xx - yy)
        value[12] = scalar(0.3731763325901154) * z * (scalar(2.0) * zz - scalar(3.0) * xx - scalar(3.0) * yy)
        value[13] = scalar(-0.4570457994644658) * x * (scalar(4.0) * zz - xx - yy)
        value[14] = scalar(1.445305721320277) * z * (xx - yy)
        value[15] = scalar(-0.5900435899266435) * x * (xx - scalar(3.0) * yy)
        return value

    @wp.func
    def hit_of(record: splat, origin: vector, direction: vector):
        hit = Hit()
        towards = part(record, 0) - origin
        normal = part(record, 9)
        hit.inverse = scalar(1.0) / wp.dot(normal, direction)
        hit.depth = wp.dot(normal, towards) * hit.inverse
        hit.offset = hit.depth * direction - towards
        hit.u = wp.dot(part(record, 3), hit.offset)
        hit.v = wp.dot(part(record, 6), hit.offset)
        hit.bell = wp.exp(scalar(-0.5) * (hit.u * hit.u + hit.v * hit.v))
        hit.full = record[12] * hit.bell
        hit.alpha = wp.min(hit.full, ceiling)
        return hit

    @wp.func
    def colour_of(sh: wp.array2d(dtype=vector), surfel: wp.int32, basis: basis_type):
        colour = vector(scalar(0.5), scalar(0.5), scalar(0.5))
        for term in range(sh.shape[1]):
            colour += basis[term] * sh[surfel, term]
        return colour

    @wp.func
    def clamped(colour: vector):
        return vector(wp.max(colour[0], scalar(0.0)), wp.max(colour[1], scalar(0.0)), wp.max(colour[2], scalar(0.0)))

    @wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
    def gather(
        first: wp.int32,
        rays: wp.array(dtype=wp.int32),
        origin: wp.array(dtype=vector),
        direction: wp.array(dtype=vector),
        start_t: wp.array(dtype=scalar),
        start_id: wp.array(dtype=wp.int32),
        start_rest: wp.array(dtype=scalar),
        stop: scalar,
        boxes: wp.array(dtype=scalar),
        first_child: wp.array(dtype=wp.int32),
        leaves: wp.array(dtype=scalar),
        order: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        found: wp.array(dtype=wp.int32),
        rest: wp.array(dtype=scalar),
        visits: wp.array(dtype=wp.int32),
    ):
        slot = first + wp.tid()
        ray = rays[slot]
        gather_hits(
            slot, origin[ray], direction[ray], start_t[slot], start_id[slot], start_rest[slot], stop,
            boxes, first_child, leaves, order, hits_t, hits_id, found, rest, visits,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
    def forward(
        first: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=vector),
        out_scalars: wp.array2d(dtype=scalar),
        out_features: wp.array(dtype=feature),
    ):
        ray = first + wp.tid()
        origin = hits.origin[ray]
        direction = hits.direction[ray]
        basis = basis_at(direction)
        left = scalar(1.0)
        depth = scalar(0.0)
        total = vector()
        blended = feature()
        for entry in range(hits.begin[ray], hits.begin[ray + 1]):
            surfel = hits.surfel[entry]
            hit = hit_of(hits.surface[surfel], origin, direction)
            weight = left * hit.alpha
            total += weight * clamped(colour_of(hits.sh, surfel, basis))
            blended += weight * hits.features[surfel]
            depth += weight * hit.depth
            left *= scalar(1.0) - hit.alpha
        out_colour[ray] = total
        out_scalars[ray, 0] = left
        out_scalars[ray, 1] = depth
        out_features[ray] = blended

    @wp.kernel(enable_backward=False, module="unique", module_options=OPTIONS)
    def backward(
        first: wp.int32,
        hits: Hits,
        colour_out: wp.array(dtype=vector),
        scalars_out: wp.array2d(dtype=scalar),
        features_out: wp.array(dtype=feature),
        pull_colour: wp.array(dtype=vector),
        pull_scalars: wp.array2d(dtype=scalar),
        pull_features: wp.array(dtype=feature),
        grad_origin: wp.array(dtype=vector),
        grad_surface: wp.array(dtype=splat),
        grad_sh: wp.array2d(dtype=vector),
        grad_features: wp.array(dtype=feature),
    ):
        ray = first + wp.tid()
        origin = hits.origin[ray]
        direction = hits.direction[ray]
        basis = basis_at(direction)
        colour_pull = pull_colour[ray]
        feature_pull = pull_features[ray]
        depth_pull = pull_scalars[ray, 1]
        # T is the product of all (1 - alpha): dL/dalpha_i gains -T dL/dT / (1 - alpha_i).
        rest_pull = pull_scalars[ray, 0] * scalars_out[ray, 0]
        behind = (
            wp.dot(colour_pull, colour_out[ray])
            + wp.dot(feature_pull, features_out[ray])
            + depth_pull * scalars_out[ray, 1]
        )
        left = scalar(1.0)
        origin_pull = vector()
        for entry in range(hits.begin[ray], hits.begin[ray + 1]):
            surfel = hits.surfel[entry]
            record = hits.surface[surfel]
            hit = hit_of(record, origin, direction)
            weight = left * hit.alpha
            raw = colour_of(hits.sh, surfel, basis)
            value = (
                wp.dot(colour_pull, clamped(raw)) + wp.dot(feature_pull, hits.features[surfel]) + depth_pull * hit.depth
            )
            behind -= weight * value
            pull_alpha = left * value - (behind + rest_pull) / (scalar(1.0) - hit.alpha)
            lit = vector()
            for axis in range(3):
                if raw[axis] > scalar(0.0):
                    lit[axis] = weight * colour_pull[axis]
            for term in range(hits.sh.shape[1]):
                wp.atomic_add(grad_sh, surfel, term, basis[term] * lit)
            wp.atomic_add(grad_features, surfel, weight * feature_pull)
            pull_bell = scalar(0.0)
            if hit.full < ceiling:
                pull_bell = pull_alpha
            pull_square = -pull_bell * hit.full
            pull_u = pull_square * hit.u
            pull_v = pull_square * hit.v
            pull_point = pull_u * part(record, 3) + pull_v * part(record, 6)
            pull_depth = (wp.dot(pull_point, direction) + weight * depth_pull) * hit.inverse
            normal = part(record, 9)
            pull_centre = pull_depth * normal - pull_point
            grad = splat()
            for axis in range(3):
                grad[axis] = pull_centre[axis]
                grad[axis + 3] = pull_u * hit.offset[axis]
                grad[axis + 6] = pull_v * hit.offset[axis]
                grad[axis + 9] = -pull_depth * hit.offset[axis]
            grad[12] = pull_bell * hit.bell
            wp.atomic_add(grad_surface, surfel, grad)
            origin_pull -= pull_centre
            left *= scalar(1.0) - hit.alpha
        grad_origin[ray] = origin_pull

    return SimpleNamespace(
        Hits=Hits, gather=gather, forward=forward, backward=backward, vector=vector, feature=feature, splat=splat
    )
