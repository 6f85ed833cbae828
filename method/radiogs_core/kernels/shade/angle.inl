// atan2 as arithmetic that the CPU compiler turns into vector code; see angle.py for its words.

// ---- angle
// ``angle``: atan2(y, x) of two numbers or vectors of the type SCALAR, in [-pi, pi], by ATAN_TERMS terms of a series.
// Beyond pi/8, atan(t) is pi/4 + atan((t - 1) / (t + 1)), and the series of atan converges at once.
auto angle = [](auto y, decltype(y) x) -> decltype(y) {
    using Number = decltype(y);
    const Number nothing = Number{}, half_circle = nothing + SCALAR(3.14159265358979323846);
    const Number across = x < nothing ? -x : x, along = y < nothing ? -y : y;
    const auto steep = along > across;
    const Number longer = steep ? along : across, shorter = steep ? across : along;
    const auto beyond = shorter > SCALAR(0.41421356237309505) * longer;
    const Number below = beyond ? shorter + longer : longer;
    const Number t = (beyond ? shorter - longer : shorter) / (below != nothing ? below : nothing + SCALAR(1));
    Number series = nothing;
    for (int term = ATAN_TERMS - 1; term >= 0; --term) series = SCALAR(1) / SCALAR(2 * term + 1) - t * t * series;
    const Number octant = t * series + (beyond ? half_circle / SCALAR(4) : nothing);
    const Number quadrant = steep ? half_circle / SCALAR(2) - octant : octant;
    const Number half_turn = x < nothing ? half_circle - quadrant : quadrant;
    return y < nothing ? -half_turn : half_turn;
};
