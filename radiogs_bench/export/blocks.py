"""Voxels in blocks that exist only near surfaces: what a truncated signed distance field is accumulated in."""

import itertools

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from radiogs_core.errors import UsageError

SIDE = 8
"""Voxels along a block's side."""

BYTES = SIDE**3 * (4 + 4)
"""Bytes of one block: a float32 sum and a float32 weight for each of its voxels."""

REACH = 2**20
"""Blocks are numbered from -REACH to REACH - 1 along each axis; three such numbers fit into 63 bits."""

Places = Int[np.ndarray, "blocks 3"]
"""Whole-number positions of blocks; block b holds the lattice points 8 b to 8 b + 7 along each axis."""

NEAR = np.array(list(itertools.product(range(SIDE), repeat=3)))
"""Lattice points of a block relative to its first one, in the order in which arrays hold them: z fastest."""


class VoxelBlocks:
    """Weighted sums of truncated distances, and sums of their weights, on a lattice.

    It is kept in blocks of 8 x 8 x 8 points that are made when first asked for.

    ``most_bytes`` bounds both arrays together. They are reserved at once, and take memory as blocks are made.
    """

    def __init__(self, most_bytes: int) -> None:
        self.most = max(most_bytes // BYTES, 1)
        self.sums: Float[np.ndarray, "blocks voxels"] = np.zeros((self.most, SIDE**3), np.float32)
        self.weights: Float[np.ndarray, "blocks voxels"] = np.zeros((self.most, SIDE**3), np.float32)
        self.places: Places = np.zeros((0, 3), np.int64)
        self._keys = pd.Index(key_of(self.places))

    def __len__(self) -> int:
        return len(self.places)

    def rows_of(self, places: Places) -> Int[np.ndarray, " blocks"]:
        """Rows of the arrays in which blocks lie; -1 for those that were not made."""
        return np.asarray(self._keys.get_indexer(key_of(places)))

    def made(self, places: Places) -> Int[np.ndarray, " blocks"]:
        """Rows of different blocks, made where they are new. Raises UsageError where that exceeds ``most_bytes``."""
        new = places[self.rows_of(places) < 0]
        if len(self) + len(new) > self.most:
            raise UsageError(
                f"the voxels need more than the {self.most * BYTES / 2**30:.3g} GiB that they may take",
                f"{self.most} blocks of {SIDE} x {SIDE} x {SIDE} voxels fit, and the surfaces seen so far need"
                f" {len(self) + len(new)}.",
                "Choose larger voxels (twice the size needs a quarter of the memory), or allow more memory.",
            )
        self.places = np.concatenate([self.places, new])
        self._keys = self._keys.append(pd.Index(key_of(new)))
        return self.rows_of(places)


def key_of(places: Places) -> Int[np.ndarray, " blocks"]:
    """One number for each block. Raises UsageError for one that is too far from the world's origin."""
    if len(places) and (places.min() < -REACH or places.max() >= REACH):
        raise UsageError(
            f"surfaces lie more than {REACH} blocks of voxels from the origin",
            "",
            "Choose larger voxels, or leave out what is far away.",
        )
    shifted = places.astype(np.int64) + REACH
    keys: Int[np.ndarray, " blocks"] = (shifted[:, 0] * 2 * REACH + shifted[:, 1]) * 2 * REACH + shifted[:, 2]
    return keys


def place_of(keys: Int[np.ndarray, " blocks"]) -> Places:
    """The inverse of ``key_of``."""
    rest, z = np.divmod(keys, 2 * REACH)
    x, y = np.divmod(rest, 2 * REACH)
    return np.stack([x, y, z], -1) - REACH
