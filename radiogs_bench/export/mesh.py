"""A mesh of a trained model, from the depth and coverage that it renders, and its record: for any method that has both.

Depth maps are fused into a field (``fusion``). Its zero level becomes triangles by scikit-image's marching cubes
(Lewiner et al. 2003). The field is cut into cubes of 64 cells a side that share their outer lattice points, so memory
does not grow with the scene. Vertices on a shared side are found twice and merged by the lattice edge that they lie on.
"""

import itertools
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from plyfile import PlyData, PlyElement
from skimage.measure import marching_cubes

from radiogs_core.contract import Maps, NotOffered, Prepared
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene, View

from ..scoring.metrics.surface_distance import chamfer, surface_distance
from ..scoring.rendering import view_on_black
from ..scoring.true_shape import true_shape
from .fusion import SIDE, Fusion, Lattice, VoxelBlocks

FINEST = 1 / 512
"""Voxels of this share of the scene's extent, unless its images are too coarse for them. 2DGS: 1/512 of the cameras'
distance."""

FINEST_IN_PIXELS = 0.5
"""Voxels are not smaller than this share of what a pixel covers at the scene's centre: they would only interpolate."""

TRUNCATION = 4.0
"""In voxels. 2DGS takes 5; the shorter, the less do the two sides of a thin part push each other apart."""

MOST_BYTES = 2 << 30
"""Default limit on the memory of voxels."""

NEEDED = ("depth", "alpha")

SCHEMA = "radiogs-bench/mesh/1"
"""The schema of mesh.json."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in world units; faces are counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]

    @property
    def face_vectors(self) -> Float[np.ndarray, "faces 3"]:
        """Outward normals of the faces, as long as twice their area."""
        first, second, third = (self.vertices[self.faces[:, corner]] for corner in range(3))
        return np.asarray(np.cross(second - first, third - first))

    @property
    def normals(self) -> Float[np.ndarray, "vertices 3"]:
        """Unit outward normals: means of the adjoining faces' by area; zero for a vertex without a face."""
        total = np.zeros_like(self.vertices)
        vectors = self.face_vectors
        for corner in range(3):
            np.add.at(total, self.faces[:, corner], vectors)
        length = np.linalg.norm(total, axis=-1, keepdims=True)
        return np.asarray(np.divide(total, length, out=np.zeros_like(total), where=length > 0))

    @property
    def area(self) -> float:
        """Square world units."""
        return float(np.linalg.norm(self.face_vectors, axis=-1).sum() / 2)


def write_mesh(mesh: Mesh, path: Path) -> None:
    """Write binary little-endian PLY: x y z and nx ny nz as float32, faces as vertex_indices. Raises OSError."""
    columns = ("x", "y", "z", "nx", "ny", "nz")
    rows = np.empty(len(mesh.vertices), dtype=[(name, "<f4") for name in columns])
    for name, values in zip(columns, np.hstack([mesh.vertices, mesh.normals]).T, strict=True):
        rows[name] = values
    faces = np.empty(len(mesh.faces), dtype=[("vertex_indices", "<i4", (3,))])
    faces["vertex_indices"] = mesh.faces
    described = [PlyElement.describe(rows, "vertex"), PlyElement.describe(faces, "face")]
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink():
        path.unlink()
    PlyData(described, byte_order="<").write(str(path))


def pixel_width(scene: Scene) -> float:
    """World units that a pixel of a training view covers at the scene's centre, in the median."""
    widths = (
        far / min(view.camera.fx, view.camera.fy) for far, view in zip(distances(scene), scene.train, strict=True)
    )
    return statistics.median(widths)


def lattice_of(scene: Scene, share: float | None = None, truncation: float = TRUNCATION) -> Lattice:
    """Voxels of ``share`` of the scene's extent (None: see ``FINEST``), and a truncation in voxels.

    Surfaces are left out beyond twice the largest distance of a camera from the scene's centre. Raises UsageError for
    sizes that make no field.
    """
    farthest = 2 * max(distances(scene))
    voxel = max(FINEST * scene.extent, FINEST_IN_PIXELS * pixel_width(scene)) if share is None else share * scene.extent
    return Lattice(voxel, truncation * voxel, farthest)


def distances(scene: Scene) -> list[float]:
    """Distance of each training camera from the scene's centre, world units."""
    centre = scene.centre
    return [float((view.camera.centre.double() - centre).norm()) for view in scene.train]


def mesh_of(
    prepared: Prepared,
    views: Sequence[View],
    lattice: Lattice,
    most_bytes: int = MOST_BYTES,
    advance: Callable[[int, int], None] = lambda done, total: None,
    *,
    device: torch.device | str = "cpu",
    method: str = "the method",
) -> Mesh:
    """The surface that a model's depth maps of some views agree on, in the world.

    Depth maps are rendered one at a time; ``advance`` receives their numbers, done and total. Raises NotOffered for a
    model that renders no depth or coverage, UsageError where voxels need more than ``most_bytes``, DataError where no
    view sees a surface.
    """
    fusion = Fusion(lattice, most_bytes)
    for done, (view, maps) in enumerate(rendered(prepared, views, NEEDED, device=device, method=method), 1):
        fusion.add(view.camera, maps["depth"][..., 0], maps["alpha"][..., 0])
        advance(done, len(views))
    return zero_level(fusion.blocks, lattice.voxel)


def rendered(
    prepared: Prepared, views: Sequence[View], needed: Sequence[str], *, device: torch.device | str, method: str
) -> Iterator[tuple[View, Maps]]:
    """Yields each view and its maps on black. Raises NotOffered if a needed map is missing."""
    lacking = [name for name in needed if name not in prepared.offers]
    if lacking:
        raise NotOffered(
            f"{method} renders no {' and no '.join(lacking)}", f"This mesh is made from {', '.join(needed)}."
        )
    further = [name for name in needed if name not in prepared.default]
    for view in views:
        yield view, view_on_black(prepared, view, torch.device(device), *further, method=method)


BLOCKS = 8
CELLS = BLOCKS * SIDE
"""Cells along a cube's side."""

LEAST = 1e-3
"""Smallest absolute value of a sampled distance, in units of the truncation. It moves a vertex by less than a hundredth
of a voxel, and keeps vertices off lattice points, where the edge that they lie on would be ambiguous."""


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
            # Scikit-image looks at a cell where the lattice point of the cell's greatest coordinates is marked.
            marked = np.pad(cells, [(1, 0)] * 3)
            points, triangles, _, _ = marching_cubes(field, 0.0, gradient_direction="descent", mask=marked)
        except RuntimeError as error:
            if "No surface found" not in str(error):
                raise
            continue
        places = points.astype(np.float64)
        vertices.append(places + cube * CELLS)
        # Twice the middle of the lattice edge, as whole numbers: even along an axis where a vertex is on the lattice.
        low = np.floor(places + LEAST / 10)
        keys.append((2 * low + (places - low > LEAST / 10)).astype(np.int64) + 2 * cube * CELLS)
        faces.append(triangles.astype(np.int64) + count)
        count += len(points)
    if not count:
        raise DataError(
            "the depth maps hold no surface",
            "No view sees one with coverage above a half.",
            "Look at the depth maps:  radiogs-bench render DIR",
        )
    _, first, merged = np.unique(np.concatenate(keys), axis=0, return_index=True, return_inverse=True)
    return Mesh((np.concatenate(vertices) * voxel)[first], merged.reshape(-1)[np.concatenate(faces)])


def _assembled(
    blocks: VoxelBlocks, cube: Int[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "n n n"], Bool[np.ndarray, "n n n"]]:
    """Mean distances at the lattice points of a cube, its far sides included, and whether views saw each point."""
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


def record_of(mesh: Mesh, scene: Scene, lattice: Lattice, views: str) -> dict[str, Any]:
    """Record of a mesh: settings in world units, and distances from the true shape as shares of the extent."""
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "checksum": scene.checksum,
        "extent": scene.extent,
        "views": views,
        "voxel": lattice.voxel,
        "truncation": lattice.truncation,
        "farthest": lattice.farthest,
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "shape": shape_of(mesh, scene),
    }


def shape_of(mesh: Mesh, scene: Scene) -> dict[str, Any]:
    """Accuracy, completeness and Chamfer distance, or the reason why they are missing."""
    try:
        truth = true_shape(scene)
        found = surface_distance(mesh.vertices, mesh.faces, truth.points, truth.distance, scene.extent)
    except DataError as unknown:
        return {"reason": f"{unknown.what}: {unknown.why}"}
    except UsageError as lacking:
        return {"reason": f"{lacking.what}: {lacking.remedy}"}
    shape = {
        "truth": truth.source,
        "accuracy": found.accuracy,
        "completeness": found.completeness,
        "chamfer": found.chamfer,
        "samples": list(found.samples),
        "seed": found.seed,
    }
    if truth.vertices is not None:
        shape["stanford_orb_chamfer"] = chamfer(mesh.vertices, mesh.faces, truth.vertices)
    return shape


def sentences_of(shape: dict[str, Any]) -> list[str]:
    """A shape's record in sentences."""
    if "reason" in shape:
        return [f"Chamfer distance: n/a, {shape['reason']}"]
    ours, theirs = shape["samples"]
    lines = [
        f"Chamfer distance {100 * shape['chamfer']:.3f} % of the scene's extent: accuracy"
        f" {100 * shape['accuracy']:.3f} % ({ours} points on the mesh), completeness"
        f" {100 * shape['completeness']:.3f} % ({theirs} true points); seed {shape['seed']}",
        f"truth: {shape['truth']}",
    ]
    if "stanford_orb_chamfer" in shape:
        lines.append(f"by Stanford-ORB's definition, mean squares in world units: {shape['stanford_orb_chamfer']:.6f}")
    return lines
