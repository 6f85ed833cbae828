// Gathering the hits of a ray in order, breadth first or nearest first; see hits.py.

// ---- ray
// Tests of a ray against a node or a leaf of the tree, eight children or surfels at once. The ray ``origin``,
// ``direction`` starts at ``start_t`` and also hits surfels from behind beyond ``back_t``.
const auto origin = origins.data[ray], direction = directions.data[ray];
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

// ---- together
// All hits of up to TOGETHER rays, breadth first through the tree: each node, then each leaf, is looked at once for all
// rays that enter it, which are the bits of a number; on the CPU only. Nothing waits for the result of the previous
// step, so that the processor works on several of them at a time. Where the rays have one origin (``of_origin`` is their
// number, else zero), what depends on it alone is computed once for all of them.
constexpr int LANES = 8;
#include "lanes.inl:vectors"
#include "lanes.inl:bits"
#include "lanes.inl:bell"
#include "lanes.inl:squeeze"
// ``squeezed`` for ``Lanes``, and ``Lanes`` of which all but the first ``some`` are ``other``.
typedef unsigned long long RayBits;
typedef RayBits EightRays __attribute__((vector_size(64)));
const Eight numbers = {0, 1, 2, 3, 4, 5, 6, 7};
auto squeezed_lanes = [&](Lanes values, int bits) -> Lanes {
    Lanes kept = Lanes{};
    if (sizeof(SCALAR) == sizeof(int)) {
        Eight words;
        memcpy(&words, &values, sizeof(words));
        words = squeezed(words, bits);
        memcpy(&kept, &words, sizeof(words));
    } else
        for (int lane = 0, at = 0; lane < 8; ++lane)
            if (bits >> lane & 1) kept[at++] = values[lane];
    return kept;
};
auto squeezed_rays = [&](EightRays rays, int bits) -> EightRays {
    const Eight low = squeezed(__builtin_convertvector(rays, Eight), bits);
    const Eight high = squeezed(__builtin_convertvector(rays >> 32, Eight), bits);
    typedef unsigned Halves __attribute__((vector_size(32)));
    return __builtin_convertvector((Halves)high, EightRays) << 32 | __builtin_convertvector((Halves)low, EightRays);
};
auto padded = [&](Lanes values, int some, SCALAR other) -> Lanes {
    return __builtin_convertvector(numbers < some, Mask) ? values : Lanes{} + other;
};
// For each ray its origin, inverse direction, direction, and the distances from which it hits fronts and backs.
SCALAR about[TOGETHER][16];
int near_side[TOGETHER][4], far_side[TOGETHER][4];
RayBits unfinished = 0;
// Several rays at once would be scattered to memory, which takes longer.
#pragma clang loop vectorize(disable)
for (int r = 0; r < count; ++r) {
    const int ray = rays.data[first + r];
    // A later round starts among hits of the previous one, which it has to skip.
    unfinished |= RayBits(starts_id.data[first + r] == NO_SURFEL) << r;
    for (int k = 0; k < 3; ++k) {
        const SCALAR d = directions.data[ray][k];
        const SCALAR inverse = d != SCALAR(0) ? SCALAR(1) / d : SCALAR(1e30);
        about[r][k] = origins.data[ray][k];
        about[r][3 + k] = inverse;
        about[r][6 + k] = d;
        near_side[r][k] = 8 * k + (inverse >= SCALAR(0) ? 0 : 24);
        far_side[r][k] = 8 * k + (inverse >= SCALAR(0) ? 24 : 0);
    }
    about[r][9] = starts_t.data[first + r];
    about[r][10] = backs_t.data[ray];
}
const SCALAR* o = about[0];

int within[MOST_NODES + 8], leaf_of[MOST_NODES + 8];
RayBits rays_in[MOST_NODES + 8], rays_on[MOST_NODES + 8];
int entered_nodes = unfinished != 0, entered_leaves = 0, node = 0, leaf = 0;
within[0] = 0;
rays_in[0] = unfinished;
for (; node < entered_nodes && entered_nodes <= MOST_NODES && entered_leaves <= MOST_NODES; ++node) {
    const SCALAR* box = boxes.data + (long long)within[node] * 48;
    EightRays entering = EightRays{};
    auto add = [&](int r, Lanes near_, Lanes far_) __attribute__((always_inline)) {
        const Lanes start = about[r][9] - Lanes{};
        near_ = near_ > start ? near_ : start;
        far_ *= SCALAR(1.0000005);
        entering |= __builtin_convertvector((near_ <= far_) & (near_ <= SCALAR(1e30)), EightRays) & (RayBits(1) << r);
    };
    nodes += __builtin_popcountll(rays_in[node]);
    if (of_origin > 0) {
        const Lanes low_x = read(box) - o[0], low_y = read(box + 8) - o[1], low_z = read(box + 16) - o[2];
        const Lanes high_x = read(box + 24) - o[0], high_y = read(box + 32) - o[1], high_z = read(box + 40) - o[2];
        for (RayBits more = rays_in[node]; more; more &= more - 1) {
            const int r = __builtin_ctzll(more);
            const SCALAR* a = about[r];
            const Lanes ax = low_x * a[3], bx = high_x * a[3];
            const Lanes ay = low_y * a[4], by = high_y * a[4];
            const Lanes az = low_z * a[5], bz = high_z * a[5];
            const Lanes near_x = ax < bx ? ax : bx, far_x = bx > ax ? bx : ax;
            const Lanes near_y = ay < by ? ay : by, far_y = by > ay ? by : ay;
            const Lanes near_z = az < bz ? az : bz, far_z = bz > az ? bz : az;
            Lanes near_ = near_x > near_y ? near_x : near_y;
            near_ = near_ > near_z ? near_ : near_z;
            Lanes far_ = far_x < far_y ? far_x : far_y;
            far_ = far_ < far_z ? far_ : far_z;
            add(r, near_, far_);
        }
        // An empty box has its sides the wrong way round.
        entering &= __builtin_convertvector(low_x <= high_x, EightRays);
    } else
        for (RayBits more = rays_in[node]; more; more &= more - 1) {
            const int r = __builtin_ctzll(more);
            const SCALAR* a = about[r];
            const int *n = near_side[r], *f = far_side[r];
            const Lanes ax = (read(box + n[0]) - a[0]) * a[3], bx = (read(box + f[0]) - a[0]) * a[3];
            const Lanes ay = (read(box + n[1]) - a[1]) * a[4], by = (read(box + f[1]) - a[1]) * a[4];
            const Lanes az = (read(box + n[2]) - a[2]) * a[5], bz = (read(box + f[2]) - a[2]) * a[5];
            Lanes near_ = ax > ay ? ax : ay;
            near_ = near_ > az ? near_ : az;
            Lanes far_ = bx < by ? bx : by;
            far_ = far_ < bz ? far_ : bz;
            add(r, near_, far_);
        }
    Eight child;
    memcpy(&child, children.data + (long long)within[node] * 8, sizeof(child));
    const int hit = bits_of(entering != 0), of_leaves = hit & bits_of(child < 0), of_nodes = hit ^ of_leaves;
    const Eight deeper = squeezed(child, of_nodes), reached = squeezed(-1 - child, of_leaves);
    const EightRays deeper_rays = squeezed_rays(entering, of_nodes), reaching = squeezed_rays(entering, of_leaves);
    memcpy(within + entered_nodes, &deeper, sizeof(deeper));
    memcpy(rays_in + entered_nodes, &deeper_rays, sizeof(deeper_rays));
    memcpy(leaf_of + entered_leaves, &reached, sizeof(reached));
    memcpy(rays_on + entered_leaves, &reaching, sizeof(reaching));
    entered_nodes += __builtin_popcount(of_nodes);
    entered_leaves += __builtin_popcount(of_leaves);
}

// The hits of each ray, in the order in which they are found.
SCALAR t_of[TOGETHER][MOST_HITS + 16], bell_of[TOGETHER][MOST_HITS + 16], alpha_of[TOGETHER][MOST_HITS + 16];
int id_of[TOGETHER][MOST_HITS + 16], met[TOGETHER];
for (int r = 0; r < count; ++r) met[r] = 0;
if (node < entered_nodes) unfinished = 0;
while (unfinished && leaf < entered_leaves) {
    // The distances and squared radii of a ray and a leaf, and bits of those that are hits. Three pairs of four have
    // none, and are overwritten by the next pair.
    SCALAR t_met[MOST_MET][8], square_met[MOST_MET][8];
    int of_ray[MOST_MET], of_leaf[MOST_MET], bits_met[MOST_MET], pairs = 0;
    for (; leaf < entered_leaves && pairs < MOST_MET - TOGETHER; ++leaf) {
        if (leaf + 2 < entered_leaves) {
            const SCALAR* line = leaves.data + leaf_of[leaf + 2] * 112LL;
            for (int k = 0; k < 7; ++k) FETCH(line + 16 * k);
        }
        const SCALAR* f = leaves.data + leaf_of[leaf] * 112LL;
        const Lanes ux = read(f + 24), uy = read(f + 32), uz = read(f + 40);
        const Lanes vx = read(f + 48), vy = read(f + 56), vz = read(f + 64);
        const Lanes nx = read(f + 72), ny = read(f + 80), nz = read(f + 88), widest = read(f + 104);
        auto add = [&](int r, Lanes slope, Lanes t, Lanes square) __attribute__((always_inline)) {
            const SCALAR* a = about[r];
            const int hit = bits_of(
                ((slope < SCALAR(0)) | (t >= a[10])) & (square <= widest) & (t > a[9]));
            write(t_met[pairs], t);
            write(square_met[pairs], square);
            of_ray[pairs] = r;
            of_leaf[pairs] = leaf_of[leaf];
            bits_met[pairs] = hit;
            pairs += hit != 0;
        };
        leaf_count += __builtin_popcountll(rays_on[leaf]);
        if (of_origin > 0) {
            const Lanes px = read(f) - o[0], py = read(f + 8) - o[1], pz = read(f + 16) - o[2];
            const Lanes reach = nx * px + ny * py + nz * pz;
            const Lanes up = ux * px + uy * py + uz * pz, vp = vx * px + vy * py + vz * pz;
            for (RayBits more = rays_on[leaf]; more; more &= more - 1) {
                const int r = __builtin_ctzll(more);
                const SCALAR* d = about[r] + 6;
                const Lanes slope = nx * d[0] + ny * d[1] + nz * d[2];
                // Parallel to the surfel t is infinite or NaN, and so is the square.
                const Lanes t = reach / slope;
                const Lanes u = t * (ux * d[0] + uy * d[1] + uz * d[2]) - up;
                const Lanes v = t * (vx * d[0] + vy * d[1] + vz * d[2]) - vp;
                add(r, slope, t, u * u + v * v);
            }
        } else
            for (RayBits more = rays_on[leaf]; more; more &= more - 1) {
                const int r = __builtin_ctzll(more);
                const SCALAR* a = about[r];
                const Lanes px = read(f) - a[0], py = read(f + 8) - a[1], pz = read(f + 16) - a[2];
                const Lanes slope = nx * a[6] + ny * a[7] + nz * a[8];
                const Lanes reach = nx * px + ny * py + nz * pz;
                const Lanes t = reach / slope;
                const Lanes x = t * a[6] - px, y = t * a[7] - py, z = t * a[8] - pz;
                const Lanes u = ux * x + uy * y + uz * z, v = vx * x + vy * y + vz * z;
                add(r, slope, t, u * u + v * v);
            }
    }
    for (int k = 0; k < pairs; ++k) {
        const int r = of_ray[k], hit = bits_met[k], at = met[r] < MOST_HITS ? met[r] : MOST_HITS;
        Eight ids;
        memcpy(&ids, order.data + of_leaf[k] * 8LL, sizeof(ids));
        const Eight its_id = squeezed(ids, hit);
        memcpy(id_of[r] + at, &its_id, sizeof(its_id));
        write(t_of[r] + at, squeezed_lanes(read(t_met[k]), hit));
        write(bell_of[r] + at, squeezed_lanes(read(square_met[k]), hit));
        write(alpha_of[r] + at, squeezed_lanes(read(leaves.data + of_leaf[k] * 112LL + 96), hit));
        met[r] += __builtin_popcount(hit);
    }
}

// ---- in_order
// ``put_in_order``: writes the hits of ray ``r`` from ``place`` on, in the order of (distance, surfel); returns how many
// of them count. ``folded``: lanes joined two by two.
auto folded = [](Lanes all, auto join) -> SCALAR {
    const auto four = join(
        __builtin_shufflevector(all, all, 0, 1, 2, 3), __builtin_shufflevector(all, all, 4, 5, 6, 7));
    const auto two = join(__builtin_shufflevector(four, four, 0, 1), __builtin_shufflevector(four, four, 2, 3));
    return join(two[0], two[1]);
};
auto put_in_order = [&](int r, int place, SCALAR rest) -> int {
    SCALAR *own_t = t_of[r], *own_alpha = alpha_of[r];
    SCALAR *hit_t = hits_t.data + place, *hit_alpha = hits_alpha.data + place;
    int *own_id = id_of[r], *hit_id = hits_id.data + place, all = met[r];
    auto find_alphas = [&](int vectors) __attribute__((always_inline)) {
        for (int v = 0; v < vectors; ++v) {
            const Lanes alpha = read(own_alpha + 8 * v) * bell(read(bell_of[r] + 8 * v));
            write(own_alpha + 8 * v, alpha < SCALAR(MAX_ALPHA) ? alpha : Lanes{} + SCALAR(MAX_ALPHA));
        }
    };
    // The rank of a hit is the number of hits before it; those of what follows the last hit lie behind it.
    auto sort = [&](int vectors) __attribute__((always_inline)) {
        Eight ranks[MOST_HITS / 8 + 1], sum = Eight{};
        for (int i = 0; i < vectors; ++i) ranks[i] = Eight{};
        for (int j = 0; j < vectors; ++j) {
            const Lanes others = padded(read(own_t + 8 * j), all - 8 * j, SCALAR(__builtin_inf()));
            for (int i = 0; i < vectors; ++i) {
                const Lanes t = read(own_t + 8 * i);
                #pragma unroll
                for (int k = 0; k < 8; ++k) ranks[i] -= __builtin_convertvector(others[k] < t, Eight);
            }
        }
        for (int i = 0; i < vectors; ++i) {
            const Eight given = numbers < all - 8 * i;
            sum += given ? ranks[i] : Eight{};
            ranks[i] = given ? ranks[i] : 8 * i + numbers;
        }
        if (__builtin_reduce_add(sum) != all * (all - 1) / 2)  // some are at the same distance
            for (int i = 0; i < all; ++i)
                for (int j = 0; j < all; ++j)
                    ranks[i / 8][i % 8] += own_t[j] == own_t[i] && own_id[j] < own_id[i];
        for (int i = 0; i < vectors; ++i) {
            #pragma unroll
            for (int k = 0; k < 8; ++k) {
                const int rank = ranks[i][k];
                hit_t[rank] = own_t[8 * i + k];
                hit_id[rank] = own_id[8 * i + k];
                hit_alpha[rank] = own_alpha[8 * i + k];
            }
        }
    };
    auto find_alphas_and_sort = [&](int vectors) __attribute__((always_inline)) {
        find_alphas(vectors);
        sort(vectors);
    };
    // Code of a fixed length has fewer branches that the processor guesses wrong.
    switch ((all + 7) / 8) {
    case 0: return 0;
    case 1: find_alphas_and_sort(1); break;
    case 2: find_alphas_and_sort(2); break;
    case 3: find_alphas_and_sort(3); break;
    case 4: find_alphas_and_sort(4); break;
    default:
        find_alphas((all + 7) / 8);
        // Where the nearer hits let too little light through, the farther ones are dropped before the rest is sorted:
        // it takes time with the square of their number. The product is rounded in another order than below, hence
        // 0.999.
        while (all > FEW_HITS) {
            Lanes sum = Lanes{}, light = Lanes{} + SCALAR(1);
            for (int i = 0; i < all; i += 8) sum += padded(read(own_t + i), all - i, SCALAR(0));
            const SCALAR middle = folded(sum, [](auto a, auto b) { return a + b; }) / all;
            for (int i = 0; i < all; i += 8) {
                const Lanes alpha = padded(read(own_alpha + i), all - i, SCALAR(0));
                light *= SCALAR(1) - (read(own_t + i) <= middle ? alpha : Lanes{});
            }
            if (!(rest * folded(light, [](auto a, auto b) { return a * b; }) < SCALAR(0.999) * stop)) break;
            int nearer = 0;
            for (int i = 0; i < all; i += 8) {
                const Lanes t = read(own_t + i), alpha = read(own_alpha + i);
                Eight id;
                memcpy(&id, own_id + i, sizeof(id));
                const int kept = bits_of((t <= middle) & __builtin_convertvector(numbers < all - i, Mask));
                const Eight id_kept = squeezed(id, kept);
                write(own_t + nearer, squeezed_lanes(t, kept));
                write(own_alpha + nearer, squeezed_lanes(alpha, kept));
                memcpy(own_id + nearer, &id_kept, sizeof(id_kept));
                nearer += __builtin_popcount(kept);
            }
            if (nearer == all) break;
            all = nearer;
        }
        sort((all + 7) / 8);
    }
    int found = 0;
    for (; found < all && rest >= stop; ++found) rest *= SCALAR(1) - hit_alpha[found];
    return found;
};

// ---- nearest_first
// The hits of a ray nearest first: nodes beyond the last hit that counts are not visited.
SCALAR left[BUFFER + 1];
SCALAR limit = huge;
int found = 0, top = 0, closed = 0, node = 0;
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
found_out.data[slot] = found;
rest_out.data[slot] = found == BUFFER && left[found] >= stop ? left[found] : SCALAR(FINISHED);

// ---- gather
#if ON_CUDA
#define FETCH(address)
const int slot = item, ray = rays.data[slot];
const long long place = (long long)slot * BUFFER;
SCALAR *hit_t = hits_t.data + place, *hit_alpha = hits_alpha.data + place;
int* hit_id = hits_id.data + place;
const SCALAR start_t = starts_t.data[slot], start_rest = starts_rest.data[slot], back_t = backs_t.data[ray];
const int start_id = starts_id.data[slot];
int nodes = 0, leaf_count = 0;
constexpr int LANES = 1;
#include "lanes.inl:vectors"
#include "lanes.inl:bits"
#include "lanes.inl:bell"
#include "ray"
#include "nearest_first"
#else
#define FETCH(address) __builtin_prefetch(address)
// Rays of one origin are divided evenly.
const int parts = of_origin > 0 ? (of_origin + TOGETHER - 1) / TOGETHER : 1;
const int size = of_origin > 0 ? (of_origin + parts - 1) / parts : TOGETHER;
const int first = of_origin > 0 ? item / parts * of_origin + item % parts * size : item * TOGETHER;
const int end = of_origin > 0 ? (item / parts + 1) * of_origin : rays.shape[0];
const int count = end - first < size ? end - first : size;
int nodes = 0, leaf_count = 0;
#include "together"
#include "in_order"
for (int r = 0; r < count; ++r) {
    const int slot = first + r, ray = rays.data[slot], place = used.data[0];
    const SCALAR start_rest = starts_rest.data[slot];
    if (place + MOST_HITS + 8 > hits_t.shape[0]) {
        found_out.data[slot] = 0;
        rest_out.data[slot] = start_rest;
        continue;
    }
    if ((unfinished >> r & 1) && met[r] <= MOST_HITS) {
        const int found = put_in_order(r, place, start_rest);
        used.data[0] += found;
        found_out.data[slot] = found;
        rest_out.data[slot] = SCALAR(FINISHED);
        continue;
    }
    SCALAR *hit_t = hits_t.data + place, *hit_alpha = hits_alpha.data + place;
    int* hit_id = hits_id.data + place;
    const SCALAR start_t = starts_t.data[slot], back_t = backs_t.data[ray];
    const int start_id = starts_id.data[slot];
#include "ray"
#include "nearest_first"
    used.data[0] += found;
}
#endif
nodes_out.data[item] = nodes;
leaves_out.data[item] = leaf_count;

// ---- pack
for (int step = 0; step < found.data[slot]; ++step) {
    const int from = begin.data[slot] + step, to = target.data[slot] + step;
    depth.data[to] = hits_t.data[from];
    surfel.data[to] = hits_id.data[from];
    alpha.data[to] = hits_alpha.data[from];
}
