"""What a ray does at a node and at a leaf of the tree, eight children or surfels at once: text of native snippets.

For a ray ``origin``, ``direction``, followed from ``start_t`` on, which meets surfels from behind from ``back_t`` on.
"""

from ..lanes import BELL, BITS, VECTORS

RAY = (
    """
#if ON_CUDA
    #define FETCH(address)
    constexpr int LANES = 1;
#else
    #define FETCH(address) __builtin_prefetch(address)
    constexpr int LANES = 8;
#endif
"""
    + VECTORS
    + BITS
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

    // Which children's boxes the ray is in before ``limit``, and where it enters them.
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

    // Which surfels of a leaf the ray meets up to ``limit``, where, and at what squared distance from their centres.
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
"""
)
