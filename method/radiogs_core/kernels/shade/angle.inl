// atan2 as arithmetic that the CPU compiler turns into vector code; see angle.py for its words.

// ---- angle
// ``angle``: atan2(y, x) of two numbers of the type SCALAR, in [-pi, pi], by ATAN_TERMS terms of a series.
// Beyond pi/8, atan(t) is pi/4 + atan((t - 1) / (t + 1)), and the series of atan converges at once.
auto angle = [](SCALAR y, SCALAR x) -> SCALAR {
    const SCALAR across = x < 0 ? -x : x, along = y < 0 ? -y : y;
    const bool steep = along > across;
    const SCALAR longer = steep ? along : across, shorter = steep ? across : along;
    const bool beyond = shorter > SCALAR(0.41421356237309505) * longer;
    const SCALAR below = beyond ? shorter + longer : longer;
    const SCALAR t = (beyond ? shorter - longer : shorter) / (below != 0 ? below : SCALAR(1));
    SCALAR series = 0;
    for (int term = ATAN_TERMS - 1; term >= 0; --term) series = SCALAR(1) / SCALAR(2 * term + 1) - t * t * series;
    const SCALAR octant = t * series + (beyond ? SCALAR(3.14159265358979323846 / 4) : SCALAR(0));
    const SCALAR quadrant = steep ? SCALAR(3.14159265358979323846 / 2) - octant : octant;
    const SCALAR half_turn = x < 0 ? SCALAR(3.14159265358979323846) - quadrant : quadrant;
    return y < 0 ? -half_turn : half_turn;
};
