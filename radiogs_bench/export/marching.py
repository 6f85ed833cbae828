"""The zero level of a fused field as a triangle mesh, by scikit-image's marching cubes (Lewiner et al. 2003).

The field is cut into cubes of 64 cells a side that share their outer lattice points, so memory does not grow with the
scene. Vertices on a shared side are found twice and merged by the lattice edge that they lie on.
"""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int
from skimage.measure import marching_cubes

from radiogs_core.errors import DataError

from .blocks import SIDE, Places, VoxelBlocks
from .mesh import Mesh

BLOCKS = 8
CELLS = BLOCKS * SIDE
"""Along a cube's side."""

LEAST = 1e-3
"""Smallest size of a sampled distance, in units of the truncation: a smaller one moves its vertex by less than a
hundredth of a voxel, and without it a vertex could lie on a lattice point, of which nobody can say on which edge."""


def zero_level(blocks: VoxelBlocks, voxel: float) -> Mesh:
    """The surface where the mean distance is zero, with ``voxel`` world units between lattice points.

    A cell with a corner that no view has seen gets no face: where no view looks, the mesh has a hole. Raises DataError
    for a field without any surface.
    """
    vertices, faces, keys, count = [], [], [], 0
    for cube in np.unique(blocks.places // BLOCKS, axis=0):
        field, seen = _assembled(blocks, cube)
        cells = _whole_cells(seen)
        if not cells.any() or field[seen].min() >= 0 or field[seen].max() <= 0:
            continue
        try:
            points, triangles, _, _ = marching_cubes(
                field, 0.0, gradient_direction="descent", mask=_at_upper_corner(cells)
            )
        except RuntimeError as nothing:
            if not _is_empty(nothing):
                raise
            continue
        places = points.astype(np.float64)
        vertices.append(places + cube * CELLS)
        keys.append(_edges(places) + 2 * cube * CELLS)
        faces.append(triangles.astype(np.int64) + count)
        count += len(points)
    if not count:
        raise DataError(
            "the depth maps hold no surface",
            "No view sees one with coverage above a half.",
            "Look at the depth maps:  radiogs-bench render DIR",
        )
    return _merged(np.concatenate(vertices) * voxel, np.concatenate(keys), np.concatenate(faces))


def _is_empty(error: RuntimeError) -> bool:
    """Whether scikit-image says that it has found no surface within the cells that it may look at."""
    return "No surface found" in str(error)


def _assembled(
    blocks: VoxelBlocks, cube: Int[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "n n n"], Bool[np.ndarray, "n n n"]]:
    """Mean distances at a cube's lattice points, its far sides included, and which of them were seen."""
    around = np.array(list(itertools.product(range(BLOCKS + 1), repeat=3)))
    rows = blocks.rows_of(np.asarray(cube * BLOCKS + around))
    sums, weights = blocks.sums[rows], blocks.weights[rows] * (rows >= 0)[:, None]
    means = np.divide(sums, weights, out=np.ones_like(sums), where=weights > 0)
    means = np.where(np.abs(means) < LEAST, np.copysign(np.float32(LEAST), means), means)
    return _lattice(means), _lattice(weights > 0)


def _lattice(values: np.ndarray) -> np.ndarray:
    """Blocks of voxels, one after the other, as one array of lattice points."""
    parted = values.reshape(*[BLOCKS + 1] * 3, *[SIDE] * 3).transpose(0, 3, 1, 4, 2, 5)
    return np.ascontiguousarray(parted.reshape([(BLOCKS + 1) * SIDE] * 3)[: CELLS + 1, : CELLS + 1, : CELLS + 1])


def _whole_cells(seen: Bool[np.ndarray, "n n n"]) -> Bool[np.ndarray, "m m m"]:
    """Cells whose eight corners were seen."""
    whole = np.ones([CELLS] * 3, bool)
    for x, y, z in itertools.product((0, 1), repeat=3):
        whole &= seen[x : x + CELLS, y : y + CELLS, z : z + CELLS]
    return whole


def _at_upper_corner(cells: Bool[np.ndarray, "m m m"]) -> Bool[np.ndarray, "n n n"]:
    """Scikit-image's mask: it looks at a cell where the lattice point of the cell's greatest coordinates is marked."""
    return np.pad(cells, [(1, 0)] * 3)


def _edges(places: Float[np.ndarray, "vertices 3"]) -> Places:
    """Twice the lattice edge's middle, as whole numbers: even along an axis where a vertex is on the lattice."""
    low = np.floor(places + LEAST / 10)
    return (2 * low + (places - low > LEAST / 10)).astype(np.int64)


def _merged(vertices: Float[np.ndarray, "vertices 3"], keys: Places, faces: Int[np.ndarray, "faces 3"]) -> Mesh:
    """One vertex for each key."""
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return Mesh(vertices[first], place.reshape(-1)[faces])
