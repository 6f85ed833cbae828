"""How images are cut for kernels: an item is a block of one row's pixels.

On the CPU a block is ``COLUMNS`` pixels wide, so that loops over it are vector code; for CUDA it is one pixel.
"""

COLUMNS = 64
"""Pixels of a block on the CPU."""


def columns_of(on_cuda: bool) -> int:
    """Pixels of a block."""
    return 1 if on_cuda else COLUMNS


def blocks_in(height: int, width: int, columns: int) -> int:
    """Blocks of an image."""
    return height * -(-width // columns)


BLOCK = """
    constexpr int reach = REACH, wide = ENTRIES * (BLOCK_COLUMNS + 2 * reach);
    const int blocks = (width + BLOCK_COLUMNS - 1) / BLOCK_COLUMNS;
    const int begin = item % blocks * BLOCK_COLUMNS;
    const int row = item / blocks % height;
    const int end = begin + BLOCK_COLUMNS < width ? begin + BLOCK_COLUMNS : width;
    const int low = begin > reach ? begin - reach : 0;
    const int high = end + reach < width ? end + reach : width;
    const int first = ENTRIES * (low - begin + reach), count = ENTRIES * (high - low);
    const int own = ENTRIES * (end - begin);
"""
"""Where block ``item`` lies, and the columns [low, high) that are at most ``reach`` further on either side.

A pixel has ENTRIES channels, interleaved. In arrays that are ``wide``, the ``count`` entries of these columns begin at
``first``, and the ``own`` entries of the block itself at ENTRIES * reach.
"""
