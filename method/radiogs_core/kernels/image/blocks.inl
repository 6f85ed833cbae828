// A block of one row's pixels; see blocks.py.

// ---- block
// Position of block ``item``, and the columns [low, high) at most ``reach`` beyond it on either side.
//
// A pixel has ENTRIES channels, interleaved. In arrays that are ``wide``, the ``count`` entries of these columns begin
// at ``first``, and the ``own`` entries of the block itself at ENTRIES * reach.
constexpr int reach = REACH, wide = ENTRIES * (BLOCK_COLUMNS + 2 * reach);
const int blocks = (width + BLOCK_COLUMNS - 1) / BLOCK_COLUMNS;
const int begin = item % blocks * BLOCK_COLUMNS;
const int row = item / blocks % height;
const int end = begin + BLOCK_COLUMNS < width ? begin + BLOCK_COLUMNS : width;
const int low = begin > reach ? begin - reach : 0;
const int high = end + reach < width ? end + reach : width;
const int first = ENTRIES * (low - begin + reach), count = ENTRIES * (high - low);
const int own = ENTRIES * (end - begin);
