// Gathering the hits of a ray in order, breadth first or nearest first; see hits_source.py.

// ---- ray
// Tests of a ray against a node or a leaf of the tree, eight children or surfels at once. The ray ``origin``,
// ``direction`` starts at ``start_t`` and also hits surfels from behind beyond ``back_t``.
#if ON_CUDA
#define FETCH(address)
constexpr int LANES = 1;
#else
#define FETCH(address) __builtin_prefetch(address)
constexpr int LANES = 8;
#endif
#include "lanes.inl:vectors"
#include "lanes.inl:bits"
#include "lanes.inl:bell"
const SCALAR ox = origin[0], oy = origin[1], oz = origin[2];
const SCALAR dx = direction[0], dy = direction[1], dz = direction[2];
const SCALAR huge = SCALAR(1e30);
const SCALAR ix = dx != SCALAR(0) ? SCALAR(1) / dx : huge;
const SCALAR iy = dy != SCALAR(0) ? SCALAR(1) / dy : huge;
const SCALAR iz = dz != SCALAR(0) ? SCALAR(1) / dz : huge;
const int nx = ix >= SCALAR(0) ? 0 : 24, ny = iy >= SCALAR(0) ? 8 : 32, nz = iz >= SCALAR(0) ? 16 : 40;
const int fx = 24 - nx, fy = 40 - ny, fz = 56 - nz;

// Children whose boxes the ray enters before ``limit``, and the distances at which it enters them.
auto entered = [&](int node, SCALAR limit, SCALAR* enter) -> int {
    const SCALAR* box = boxes.data + (long long)node * 48;
    int bits = 0;
    for (int c = 0; c < 8; c += LANES) {
        const Lanes ax = (read(box + nx + c) - ox) * ix, bx = (read(box + fx + c) - ox) * ix;
        const Lanes ay = (read(box + ny + c) - oy) * iy, by = (read(box + fy + c) - oy) * iy;
        const Lanes az = (read(box + nz + c) - oz) * iz, bz = (read(box + fz + c) - oz) * iz;
        Lanes near_ = ax > ay ? ax : ay;
        near_ = near_ > az ? near_ : az;
        near_ = near_ > start_t ? near_ : Lanes{} + start_t;
        Lanes far_ = bx < by ? bx : by;
        far_ = far_ < bz ? far_ : bz;
        far_ *= SCALAR(1.0000005);
        far_ = far_ < limit ? far_ : Lanes{} + limit;
        write(enter + c, near_);
        bits |= bits_of(near_ <= far_) << c;
    }
    return bits;
};

// Surfels of a leaf that the ray hits up to ``limit``, their distances, and their squared radii on the surfel.
auto met_on = [&](int leaf, SCALAR limit, SCALAR* depth, SCALAR* square) -> int {
    const SCALAR* f = leaves.data + (long long)leaf * 112;
    int bits = 0;
    for (int c = 0; c < 8; c += LANES) {
        const Lanes px = read(f + c) - ox, py = read(f + 8 + c) - oy, pz = read(f + 16 + c) - oz;
        const Lanes slope = read(f + 72 + c) * dx + read(f + 80 + c) * dy + read(f + 88 + c) * dz;
        const Lanes reach = read(f + 72 + c) * px + read(f + 80 + c) * py + read(f + 88 + c) * pz;
        const Mask faces = slope < SCALAR(0), turned = slope > SCALAR(0);
        const Lanes t = reach / ((faces | turned) ? slope : Lanes{} - SCALAR(1));
        const Lanes x = t * dx - px, y = t * dy - py, z = t * dz - pz;
        const Lanes u = read(f + 24 + c) * x + read(f + 32 + c) * y + read(f + 40 + c) * z;
        const Lanes v = read(f + 48 + c) * x + read(f + 56 + c) * y + read(f + 64 + c) * z;
        const Lanes from_centre = u * u + v * v;
        const Mask seen = faces | (turned & (t >= back_t));
        write(depth + c, t);
        write(square + c, from_centre);
        bits |= bits_of(seen & (from_centre <= read(f + 104 + c)) & (t >= start_t) & (t <= limit)) << c;
    }
    return bits;
};
auto fetch_leaf = [&](int leaf) {
    const SCALAR* line = leaves.data + (long long)leaf * 112;
    for (int k = 0; k < 7; ++k) FETCH(line + 16 * k);
};

// ---- breadth_first
// All hits of a ray at once: breadth first through the tree, then its leaves, then the hits in order; on the CPU only.
// No node depends on the result of the previous one, and nothing branches on it, so that the processor works on several
// of them at a time. Nearest first takes twice as long on M, although it skips nodes behind an opaque surface (there a
// fifth of the nodes and leaves).
#if !ON_CUDA
#include "lanes.inl:squeeze"
// A later round starts among hits of the previous one, which it has to skip.
if (start_id == NO_SURFEL) {
    int within[MOST_NODES + 8], leaf_of[MOST_NODES + 8];
    int entered_nodes = 1, entered_leaves = 0, nodes = 0, leaf_count = 0, met = 0;
    within[0] = 0;
    for (; nodes < entered_nodes && entered_nodes <= MOST_NODES && entered_leaves <= MOST_NODES; ++nodes) {
        SCALAR enter[8];
        const int hit = entered(within[nodes], huge, enter);
        Eight child;
        memcpy(&child, children.data + (long long)within[nodes] * 8, sizeof(child));
        const int of_leaves = hit & bits_of(child < 0), of_nodes = hit ^ of_leaves;
        const Eight deeper = squeezed(child, of_nodes), reached = squeezed(-1 - child, of_leaves);
        memcpy(within + entered_nodes, &deeper, sizeof(deeper));
        memcpy(leaf_of + entered_leaves, &reached, sizeof(reached));
        entered_nodes += __builtin_popcount(of_nodes);
        entered_leaves += __builtin_popcount(of_leaves);
    }

    SCALAR depth[8 * MOST_NODES + 64], square[8 * MOST_NODES + 64];
    int place[MOST_HITS + 8];
    const bool all_nodes = nodes == entered_nodes;
    for (; all_nodes && leaf_count < entered_leaves && met <= MOST_HITS; ++leaf_count) {
        if (leaf_count + 3 < entered_leaves) fetch_leaf(leaf_of[leaf_count + 3]);
        const int first = 8 * leaf_count;
        const int hit = met_on(leaf_of[leaf_count], huge, depth + first, square + first)
            & bits_of(read(depth + first) > start_t);
        const Eight places = squeezed(first + Eight{0, 1, 2, 3, 4, 5, 6, 7}, hit);
        memcpy(place + met, &places, sizeof(places));
        met += __builtin_popcount(hit);
    }

    if (all_nodes && leaf_count == entered_leaves && met <= MOST_HITS) {
        SCALAR t_of[MOST_HITS + 8], bell_of[MOST_HITS + 8], alpha_of[MOST_HITS + 8];
        int id_of[MOST_HITS + 8], rank_of[MOST_HITS + 8];
        const int padded = (met + 7) / 8 * 8;
        for (int i = 0; i < padded; ++i) {
            const int at = i < met ? place[i] : 0, lane = at & 7, leaf = leaf_of[at >> 3];
            t_of[i] = depth[at];
            bell_of[i] = square[at];
            alpha_of[i] = leaves.data[leaf * 112LL + 96 + lane];
            id_of[i] = order.data[leaf * 8 + lane];
        }
        // The rank of a hit is the number of hits before it.
        for (int i = 0; i < padded; i += 8) {
            const Lanes t = read(t_of + i), alpha = read(alpha_of + i) * bell(read(bell_of + i));
            Eight id, before = Eight{};
            memcpy(&id, id_of + i, sizeof(id));
            for (int j = 0; j < met; ++j)
                before -= __builtin_convertvector(t_of[j] < t, Eight)
                    | (__builtin_convertvector(t_of[j] == t, Eight) & (id_of[j] < id));
            memcpy(rank_of + i, &before, sizeof(before));
            write(alpha_of + i, alpha < SCALAR(MAX_ALPHA) ? alpha : Lanes{} + SCALAR(MAX_ALPHA));
        }
        for (int i = 0; i < met; ++i) {
            hit_t[rank_of[i]] = t_of[i];
            hit_id[rank_of[i]] = id_of[i];
            hit_alpha[rank_of[i]] = alpha_of[i];
        }
        SCALAR rest = start_rest;
        int found = 0;
        for (; found < met && rest >= stop; ++found) rest *= SCALAR(1) - hit_alpha[found];
        used.data[0] += found;
        found_out.data[slot] = found;
        rest_out.data[slot] = SCALAR(FINISHED);
        nodes_out.data[slot] = nodes;
        leaves_out.data[slot] = leaf_count;
        return;
    }
}
#endif

// ---- nearest_first
// The hits of a ray nearest first: nodes beyond the last hit that counts are not visited.
SCALAR left[BUFFER + 1];
SCALAR limit = huge;
int found = 0, nodes = 0, leaf_count = 0, top = 0, closed = 0, node = 0;
int stack_node[STACK];
SCALAR stack_t[STACK];
left[0] = start_rest;
for (;;) {
    if (node >= 0) {
        ++nodes;
        SCALAR enter[8];
        const int* child = children.data + (long long)node * 8;
        int bits = entered(node, limit, enter);
        if (bits) {
            // The nearest child is visited next; the others are pushed on the stack, the farthest first.
            int c = LOWEST(bits);
            bits &= bits - 1;
            int next = child[c];
            SCALAR next_t = enter[c];
            const int begin = top;
            while (bits) {
                c = LOWEST(bits);
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
                // Nodes on the stack are prefetched from beyond the second-level cache (measured: 7 %).
                if (other >= 0) {
                    FETCH(boxes.data + (long long)other * 48);
                    FETCH(boxes.data + (long long)other * 48 + 16);
                    FETCH(boxes.data + (long long)other * 48 + 32);
                } else {
                    fetch_leaf(-1 - other);
                }
            }
            node = next;
            continue;
        }
    } else {
        ++leaf_count;
        const int leaf = -1 - node;
        SCALAR depth[8], bells[8];
        int bits = met_on(leaf, limit, depth, bells);
        if (bits)
            for (int c = 0; c < 8; c += LANES) write(bells + c, bell(read(bells + c)));
        while (bits) {
            const int c = LOWEST(bits);
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
            const SCALAR alpha = leaves.data[leaf * 112LL + 96 + c] * bells[c];
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
used.data[0] += found;
found_out.data[slot] = found;
rest_out.data[slot] = found == BUFFER && left[found] >= stop ? left[found] : SCALAR(FINISHED);
nodes_out.data[slot] = nodes;
leaves_out.data[slot] = leaf_count;

// ---- gather
const int ray = rays.data[slot];
const auto origin = origins.data[ray], direction = directions.data[ray];
const SCALAR start_t = starts_t.data[slot], start_rest = starts_rest.data[slot], back_t = backs_t.data[ray];
const int start_id = starts_id.data[slot];
#include "ray"
if (slot + RAYS_AHEAD < rays.shape[0]) {
    const int later = rays.data[slot + RAYS_AHEAD];
    FETCH(origins.data + later);
    FETCH(directions.data + later);
    FETCH(backs_t.data + later);
}
#if ON_CUDA
const long long place = (long long)slot * BUFFER;
#else
const int place = used.data[0];
if (place + MOST_HITS > hits_t.shape[0]) {
    found_out.data[slot] = nodes_out.data[slot] = leaves_out.data[slot] = 0;
    rest_out.data[slot] = start_rest;
    return;
}
#endif
SCALAR *hit_t = hits_t.data + place, *hit_alpha = hits_alpha.data + place;
int* hit_id = hits_id.data + place;
#include "breadth_first"
#include "nearest_first"
