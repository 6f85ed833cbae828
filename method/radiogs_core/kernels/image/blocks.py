"""How images are divided for kernels: an item is a block of pixels in one row.

On the CPU a block is ``COLUMNS`` pixels wide, so that loops over it are vectorised; for CUDA it is one pixel.
"""

from ..arrangement import an_item
from ..native_kernel import native_file

BLOCK = native_file(__package__, "blocks.inl")
"""The file ``blocks.inl``."""

COLUMNS = 64
"""Pixels of a block on the CPU."""


def columns_of(on_cuda: bool) -> int:
    """Number of pixels of a block."""
    return an_item(on_cuda, COLUMNS)


def blocks_in(height: int, width: int, columns: int) -> int:
    """Number of blocks of ``columns`` pixels in an image; the last block of a row may be partly outside."""
    return height * -(-width // columns)
