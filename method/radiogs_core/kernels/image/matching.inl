// A plane sweep: one plane, a loop over the other views; see matching.py.

// ---- sweep
constexpr int LANES = PIXELS_AT_ONCE;
typedef SCALAR Texel __attribute__((vector_size(TEXEL * sizeof(SCALAR)), aligned(sizeof(SCALAR))));
auto texel = [](const SCALAR* from) -> Texel { return *(const Texel*)from; };
const SCALAR distance = planes.data[plane];
const int reach = window / 2, wide = columns + 2 * reach, high = rows + 2 * reach, area = rows * columns;
const long long own = (long long)high * wide + 1 + (long long)agreeing * area + wide + columns;
SCALAR* scratch = room.data + plane * own;
SCALAR *difference = scratch, *least = difference + high * wide + 1;
SCALAR *__restrict down = least + agreeing * area, *__restrict left = down + wide;
for (int k = 0; k < high * wide; ++k) difference[k] = SCALAR(0);
int kept = 0;
for (int other = 0; other < others; ++other) {
    const int width = sizes.data[3 * other], height = sizes.data[3 * other + 1];
    const SCALAR* source = textures.data + sizes.data[3 * other + 2];
    const SCALAR* begin = begins.data + 3 * other;
    const SCALAR* slope = slopes.data + 3LL * pixels * other;
    for (int first = 0; first < pixels; first += LANES) {
        SCALAR near_x[LANES], near_y[LANES];
        int corner[LANES];
        for (int c = 0; c < LANES; ++c) {
            const int pixel = first + c;
            const SCALAR z = begin[2] + slope[2 * pixels + pixel] * distance;
            const SCALAR along = SCALAR(1) / (z > SCALAR(1e-6) ? z : SCALAR(1e-6));
            // An empty pixel surrounds the image: points beyond the border, behind the camera, and NaN fall on it.
            SCALAR x = (begin[0] + slope[pixel] * distance) * along + SCALAR(1);
            SCALAR y = (begin[1] + slope[pixels + pixel] * distance) * along + SCALAR(1);
            x = x > SCALAR(0) ? x : SCALAR(0);
            y = y > SCALAR(0) ? y : SCALAR(0);
            x = x < SCALAR(width + 1) ? x : SCALAR(width + 1);
            y = y < SCALAR(height + 1) ? y : SCALAR(height + 1);
            const int column = (int)x < width ? (int)x : width, row = (int)y < height ? (int)y : height;
            near_x[c] = x - SCALAR(column);
            near_y[c] = y - SCALAR(row);
            corner[c] = TEXEL * (row * (width + 2) + column);
        }
        SCALAR seen[TEXEL * LANES], colour[TEXEL * LANES], mean[LANES];
        for (int c = 0; c < LANES; ++c) {
            const SCALAR* above = source + corner[c];
            const SCALAR* below = above + TEXEL * (width + 2);
            const Texel upper = texel(above) + near_x[c] * (texel(above + TEXEL) - texel(above));
            const Texel lower = texel(below) + near_x[c] * (texel(below + TEXEL) - texel(below));
            *(Texel*)(seen + TEXEL * c) = upper + near_y[c] * (lower - upper);
            *(Texel*)(colour + TEXEL * c) = texel(colours.data + TEXEL * (first + c));
        }
        for (int c = 0; c < LANES; ++c) {
            SCALAR sum = SCALAR(0);
            for (int i = 0; i < 3; ++i) {
                const SCALAR apart = seen[TEXEL * c + i] - colour[TEXEL * c + i];
                sum += apart < SCALAR(0) ? -apart : apart;
            }
            const bool object = seen[TEXEL * c + 3] > SCALAR(COVERED);
            mean[c] = object ? sum / SCALAR(3) : SCALAR(1);
        }
        for (int c = 0; c < LANES; ++c) difference[targets.data[first + c]] = mean[c];
    }
    // Means over squares; each row is then inserted among the smallest ones so far.
    for (int row = 0; row < rows; ++row) {
        for (int k = 0; k < wide; ++k) down[k] = SCALAR(0);
        for (int step = 0; step < window; ++step) {
            const SCALAR* __restrict line = difference + (row + step) * wide;
            for (int k = 0; k < wide; ++k) down[k] += line[k];
        }
        const SCALAR* __restrict number = inside.data + row * columns;
        for (int k = 0; k < columns; ++k) left[k] = down[k];
        for (int step = 1; step < window; ++step)
            for (int k = 0; k < columns; ++k) left[k] += down[k + step];
        for (int k = 0; k < columns; ++k) left[k] /= number[k];
        for (int rank = 0; rank < kept; ++rank) {
            SCALAR* __restrict held = least + (long long)rank * area + row * columns;
            for (int k = 0; k < columns; ++k) {
                const SCALAR one = held[k], two = left[k];
                held[k] = one < two ? one : two;
                left[k] = one < two ? two : one;
            }
        }
        if (kept < agreeing) {
            SCALAR* __restrict held = least + (long long)kept * area + row * columns;
            for (int k = 0; k < columns; ++k) held[k] = left[k];
        }
    }
    kept += kept < agreeing;
}
SCALAR* mean = out.data + (long long)plane * area;
for (int k = 0; k < area; ++k) mean[k] = least[k];
for (int rank = 1; rank < kept; ++rank)
    for (int k = 0; k < area; ++k) mean[k] += least[rank * area + k];
for (int k = 0; k < area; ++k) mean[k] /= SCALAR(kept);
