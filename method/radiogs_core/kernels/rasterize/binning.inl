// The lists of tiles; see binning.py.

// ---- entries
// Every pair of a surfel and a tile, in depth order, for sorting by tile.
const int surfel = (int)nearest_first.data[index];
const int* box = tiles.data + 4LL * surfel;
long long entry = begins.data[index];
for (int row = box[1]; row <= box[3]; ++row)
    for (int column = box[0]; column <= box[2]; ++column) {
        out_tile.data[entry] = row * across + column;
        out_member.data[entry++] = surfel;
    }

// ---- ordered
// By one thread of a CPU, as ``listed``.
// Depths are sorted by KEY_BITS of their place between the nearest and the farthest, by counting twice, and what falls
// on one key by insertion; the key never decreases with the depth. If many fall on one, all 64 bits are sorted instead.
constexpr int DIGIT = 11, DIGITS = 1 << DIGIT, LONGEST_RUN = 32;
unsigned* keys[2] = {(unsigned*)scratch.data, (unsigned*)scratch.data + surfels};
int* places[2] = {scratch.data + 2LL * surfels, scratch.data + 3LL * surfels};
const int columns = across + 1;
int drawn = 0;
long long kinds[4] = {0, 0, 0, 0};
double nearest = 0.0, farthest = 0.0;
for (int surfel = 0; surfel < surfels; ++surfel) {
    ++kinds[kind.data[surfel]];
    if (!touched.data[surfel]) continue;
    const double z = depth.data[surfel];
    nearest = drawn == 0 || z < nearest ? z : nearest;
    farthest = drawn == 0 || z > farthest ? z : farthest;
    places[0][drawn++] = surfel;
    // A tile's count is the sum over the corners above and to the left of it.
    const int *box = tiles.data + 4LL * surfel, *last = box + 2;
    ++corners.data[box[1] * columns + box[0]];
    --corners.data[box[1] * columns + last[0] + 1];
    --corners.data[(last[1] + 1) * columns + box[0]];
    ++corners.data[(last[1] + 1) * columns + last[0] + 1];
}
const double scale = double((1 << 2 * DIGIT) - 1) / (farthest - nearest);
bool is_sorted = scale > 0.0 && scale < 1e300;
if (is_sorted) {
    int begins[2][DIGITS] = {};
    for (int index = 0; index < drawn; ++index) {
        const unsigned key = unsigned((depth.data[places[0][index]] - nearest) * scale);
        keys[0][index] = key;
        ++begins[0][key % DIGITS];
        ++begins[1][key / DIGITS];
    }
    for (int pass = 0; pass < 2; ++pass) {
        int total = 0;
        for (int digit = 0; digit < DIGITS; ++digit) {
            const int number = begins[pass][digit];
            begins[pass][digit] = total;
            total += number;
        }
        for (int index = 0; index < drawn; ++index) {
            const unsigned key = keys[pass][index];
            const int to = begins[pass][pass ? key / DIGITS : key % DIGITS]++;
            keys[1 - pass][to] = key;
            places[1 - pass][to] = places[pass][index];
        }
    }
    for (int index = 1, run = 1; index < drawn && is_sorted; ++index) {
        run = keys[0][index] == keys[0][index - 1] ? run + 1 : 1;
        is_sorted = run <= LONGEST_RUN;
        if (run == 1) continue;
        const int surfel = places[0][index];
        int to = index;
        for (; to > 0 && depth.data[places[0][to - 1]] > depth.data[surfel]; --to) places[0][to] = places[0][to - 1];
        places[0][to] = surfel;
    }
}
if (!is_sorted) {
    drawn = 0;
    for (int surfel = 0; surfel < surfels; ++surfel)
        if (touched.data[surfel]) places[0][drawn++] = surfel;
    for (int pass = 0; pass < 6; ++pass) {
        // The bits of a number without its sign are in its order, and inverted for a negative one.
        auto digit_of = [&](int surfel) -> int {
            const double z = depth.data[surfel] + 0.0;
            unsigned long long bits;
            memcpy(&bits, &z, sizeof(bits));
            bits = bits >> 63 ? ~bits : bits | 1ull << 63;
            return (int)(bits >> pass * DIGIT) & (DIGITS - 1);
        };
        int begins[DIGITS + 1] = {};
        const int *from = places[pass % 2];
        for (int index = 0; index < drawn; ++index) ++begins[digit_of(from[index]) + 1];
        for (int digit = 0; digit < DIGITS; ++digit) begins[digit + 1] += begins[digit];
        for (int index = 0; index < drawn; ++index) places[1 - pass % 2][begins[digit_of(from[index])]++] = from[index];
    }
}
long long entries = 0;
for (int row = 0; row < down; ++row)
    for (int column = 0; column < across; ++column) {
        int* here = corners.data + row * columns + column;
        if (column) *here += here[-1];
        if (row) *here += here[-columns];
        if (row && column) *here -= here[-columns - 1];
        starts.data[row * across + column] = (int)entries;
        entries += *here;
    }
tally.data[0] = drawn;
tally.data[1] = entries;
tally.data[2] = kinds[0];
tally.data[3] = kinds[1];
tally.data[4] = kinds[3];

// ---- listed
// ``starts`` are cursors meanwhile; in the end each is the start of the next tile.
for (int index = 0; index < drawn; ++index) {
    const int surfel = order.data[index];
    const int* box = tiles.data + 4LL * surfel;
    for (int row = box[1]; row <= box[3]; ++row)
        for (int column = box[0]; column <= box[2]; ++column)
            members.data[starts.data[row * across + column]++] = surfel;
}
for (int tile = count; tile > 0; --tile) starts.data[tile] = starts.data[tile - 1];
starts.data[0] = 0;
