// The number by which a ray is sorted; see ray_order.py.

// ---- code
// The octant of the ray's direction, then the place of its origin on a Morton curve through the cells of the box.
// Inserts two zeros between any two of nine bits.
auto spread = [](int bits) -> int {
    bits = (bits | (bits << 16)) & 0x030000FF;
    bits = (bits | (bits << 8)) & 0x0300F00F;
    bits = (bits | (bits << 4)) & 0x030C30C3;
    return (bits | (bits << 2)) & 0x09249249;
};
int found = 0;
for (int axis = 0; axis < 3; ++axis) {
    const SCALAR place = (origin.data[3LL * ray + axis] - SCALAR(low[axis])) * cells;
    const int cell = place > SCALAR(0) ? (place < SCALAR(CELLS - 1) ? (int)place : CELLS - 1) : 0;
    found += spread(cell) << axis;
    if (direction.data[3LL * ray + axis] > SCALAR(0)) found += 1 << (27 + axis);
}
out.data[ray] = found;
