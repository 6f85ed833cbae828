"""Distances between a recovered surface and the true one, both ways: accuracy, completeness, and their mean."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.surfaces import SurfaceSamples

SAMPLES = 30_000
"""Points that are drawn from the recovered surface, as Stanford-ORB does."""

Triangles = Int[np.ndarray, "faces 3"]

Points = Float[np.ndarray, "points 3"]
Distance = Callable[[Points], Float[np.ndarray, " points"]]
"""The distance of each point from a surface, world units."""

NEAREST = 8
"""Number of cells with the nearest centres among which the cell nearest to a point is searched."""

GROWN = 1.4
"""Cells are enlarged by this factor, because cells of a spherical lattice leave gaps; cells at the edges of flat faces
are an eighth of the spacing wide, so a face grows by 1/40 of the spacing on each side."""


@dataclass(frozen=True)
class SurfaceDistance:
    """Mean distances between two surfaces, in units of the scene's extent."""

    accuracy: float
    """Mean distance of points on the recovered surface from the true one."""
    completeness: float
    """Mean distance of points on the true surface from the recovered one."""
    samples: tuple[int, int]
    """Numbers of points that were drawn on the recovered and on the true surface."""
    seed: int
    """Seed of the points."""

    @property
    def chamfer(self) -> float:
        """The mean of both: the symmetric Chamfer distance, not squared."""
        return (self.accuracy + self.completeness) / 2


def surface_distance(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Triangles,
    truth: Points,
    from_truth: Distance,
    extent: float,
    seed: int = 0,
) -> SurfaceDistance:
    """Compare a recovered mesh with a true surface, of which ``truth`` are points; nothing is aligned.

    SAMPLES points are drawn on the mesh, uniformly by area. Distances from it are exact. Raises DataError for a mesh
    without area, and where there is no true point.
    """
    if not len(truth):
        raise DataError("no point of the true surface is known")
    ours = sampled_surface(vertices, faces, SAMPLES, np.random.default_rng(seed))
    accuracy = float(np.mean(from_truth(ours))) / extent
    completeness = float(np.mean(distance_from_mesh(vertices, faces)(truth))) / extent
    return SurfaceDistance(accuracy, completeness, (len(ours), len(truth)), seed)


def chamfer(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Triangles,
    truth: Float[np.ndarray, "points 3"],
    seed: int = 0,
    samples: int = SAMPLES,
) -> float:
    """Half the sum of both mean squared distances, world units squared: recovered surface against true points.

    The recovered mesh is sampled uniformly by area; ``truth`` are the true mesh's vertices, as the benchmark has it.
    Nothing is aligned. Stanford-ORB's tables print this distance times 2000. Raises DataError for a shape without
    surface or points.
    """
    if not len(truth):
        raise DataError("the true shape has no vertices")
    ours = sampled_surface(vertices, faces, samples, np.random.default_rng(seed))
    to_truth, to_ours = cKDTree(truth).query(ours)[0], cKDTree(ours).query(truth)[0]
    return float(np.mean(np.square(to_truth)) + np.mean(np.square(to_ours))) / 2


def sampled_surface(
    vertices: Float[np.ndarray, "vertices 3"], faces: Triangles, samples: int, generator: np.random.Generator
) -> Float[np.ndarray, "samples 3"]:
    """Points drawn uniformly by area from a triangle mesh. Raises DataError for one without area."""
    corners = vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1) / 2
    if not np.isfinite(area).all() or area.sum() <= 0:
        raise DataError(
            "the recovered mesh has no surface to sample",
            f"It has {len(faces)} faces with a total area of {area.sum():g}.",
        )
    chosen = corners[generator.choice(len(faces), samples, p=area / area.sum())]
    # Uniform in a triangle: the square root turns the unit square into barycentric coordinates of equal area.
    root, share = np.sqrt(generator.random((samples, 1))), generator.random((samples, 1))
    return (1 - root) * chosen[:, 0] + root * ((1 - share) * chosen[:, 1] + share * chosen[:, 2])


def pyvista() -> Any:
    """pyvista, imported on demand, as VTK loads slowly. Raises UsageError if graphics libraries are missing."""
    try:
        return import_module("pyvista")
    except ImportError as error:
        raise UsageError(
            "meshes and windows need pyvista, which cannot be loaded",
            str(error).splitlines()[0],
            "Install what it names. VTK needs, on Debian:  apt-get install libgl1 libegl1 libxrender1",
        ) from error


def read_mesh(path: Path) -> tuple[Float[np.ndarray, "vertices 3"], Triangles]:
    """A triangle mesh from OBJ, PLY or what else VTK reads. Raises DataError for other files, UsageError without it."""
    library = pyvista()
    try:
        mesh = library.read(path).triangulate()
    except (OSError, ValueError, AttributeError) as error:
        raise DataError(f"cannot read the mesh {path}", f"{error}.") from error
    faces = np.asarray(mesh.faces).reshape(-1, 4)[:, 1:].astype(np.int64)
    if not len(faces):
        raise DataError(f"{path} holds no triangles")
    return np.asarray(mesh.points, np.float64), faces


def distance_from_mesh(vertices: Float[np.ndarray, "vertices 3"], faces: Triangles) -> Distance:
    """Exact distances from a triangle mesh, by VTK. Raises UsageError where that is not installed."""
    library = pyvista()
    mesh = library.PolyData.from_regular_faces(np.asarray(vertices, np.float64), np.asarray(faces, int))

    def distance(points: Points) -> Float[np.ndarray, " points"]:
        cloud = library.PolyData(np.asarray(points, np.float64))
        # The sign is of no use: where a mesh is open there is no inside.
        return np.abs(np.asarray(cloud.compute_implicit_distance(mesh)["implicit_distance"], np.float64))

    return distance


def distance_from_points(truth: Points) -> Distance:
    """Distances from the nearest of some points."""
    tree = cKDTree(truth)
    return lambda points: np.asarray(tree.query(points)[0])


def distance_from_cells(samples: SurfaceSamples) -> Distance:
    """Distances from flat rectangular cells, which surface samples represent."""
    centre, frame = samples.centre.numpy(), samples.frame.numpy()
    half = np.pad(GROWN * samples.size.numpy() / 2, [(0, 0), (0, 1)])
    tree = cKDTree(centre)

    def distance(points: Points) -> Float[np.ndarray, " points"]:
        _, near = tree.query(points, k=min(NEAREST, len(centre)))
        near = near.reshape(len(points), -1)
        local = np.einsum("pnij,pni->pnj", frame[near], points[:, None] - centre[near])
        beyond = np.maximum(np.abs(local) - half[near], 0)
        return np.asarray(np.linalg.norm(beyond, axis=-1).min(-1))

    return distance


def points_in_cells(samples: SurfaceSamples, count: int, seed: int = 0) -> Points:
    """Points drawn uniformly by area from the cells of surface samples."""
    generator = np.random.default_rng(seed)
    size = samples.size.numpy()
    area = size.prod(-1)
    chosen = generator.choice(len(samples), count, p=area / area.sum())
    local = (generator.random((count, 2)) - 0.5) * size[chosen]
    across = samples.frame.numpy()[chosen][..., :2]
    return np.asarray(samples.centre.numpy()[chosen] + np.einsum("pij,pj->pi", across, local))
