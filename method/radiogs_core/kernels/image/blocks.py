"""How images are cut for kernels: an item is a block of one row's pixels.

On the CPU a block is ``COLUMNS`` pixels wide, so that loops over it are vector code; for CUDA it is one pixel.
"""

from ..native_text import native_file

BLOCK = native_file(__package__, "blocks.inl")

COLUMNS = 64
"""Pixels of a block on the CPU."""


def columns_of(on_cuda: bool) -> int:
    """Pixels of a block."""
    return 1 if on_cuda else COLUMNS


def blocks_in(height: int, width: int, columns: int) -> int:
    """Blocks of an image."""
    return height * -(-width // columns)
