"""Distances between a recovered surface and the true one, both ways: accuracy, completeness, and their mean."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from radiogs_core.errors import DataError
from radiogs_core.scene.surfaces import SurfaceSamples

from .chamfer import SAMPLES, Triangles, sampled_surface
from .mesh_library import pyvista

Points = Float[np.ndarray, "points 3"]
Distance = Callable[[Points], Float[np.ndarray, " points"]]
"""The distance of each point from a surface, world units."""

NEAREST = 8
"""Cells whose middles are nearest to a point, among which the nearest cell is looked for."""

GROWN = 1.4
"""Cells are taken for this much larger, as those of a spherical lattice leave gaps between one another; those at the
edges of flat faces are an eighth of the spacing wide, so a face grows by 1/40 of it on each side."""


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

    30,000 points are drawn on the mesh, uniformly by area (as Stanford-ORB does). Distances from it are exact. Raises
    DataError for a mesh without area, and where there is no true point.
    """
    if not len(truth):
        raise DataError("no point of the true surface is known")
    ours = sampled_surface(vertices, faces, SAMPLES, np.random.default_rng(seed))
    accuracy = float(np.mean(from_truth(ours))) / extent
    completeness = float(np.mean(distance_from_mesh(vertices, faces)(truth))) / extent
    return SurfaceDistance(accuracy, completeness, (len(ours), len(truth)), seed)


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

    def distance(points: Points) -> Float[np.ndarray, " points"]:
        nearest: Float[np.ndarray, " points"] = tree.query(points)[0]
        return nearest

    return distance


def distance_from_cells(samples: SurfaceSamples) -> Distance:
    """Distances from the flat rectangular cells that surface samples stand for."""
    centre, frame = samples.centre.numpy(), samples.frame.numpy()
    half = np.pad(GROWN * samples.size.numpy() / 2, [(0, 0), (0, 1)])
    tree = cKDTree(centre)

    def distance(points: Points) -> Float[np.ndarray, " points"]:
        _, near = tree.query(points, k=min(NEAREST, len(centre)))
        near = near.reshape(len(points), -1)
        local = np.einsum("pnij,pni->pnj", frame[near], points[:, None] - centre[near])
        beyond = np.maximum(np.abs(local) - half[near], 0)
        nearest: Float[np.ndarray, " points"] = np.linalg.norm(beyond, axis=-1).min(-1)
        return nearest

    return distance


def points_in_cells(samples: SurfaceSamples, count: int, seed: int = 0) -> Points:
    """Points drawn uniformly by area from the cells of surface samples."""
    generator = np.random.default_rng(seed)
    size = samples.size.numpy()
    area = size.prod(-1)
    chosen = generator.choice(len(samples), count, p=area / area.sum())
    local = (generator.random((count, 2)) - 0.5) * size[chosen]
    drawn: Points = samples.centre.numpy()[chosen] + np.einsum(
        "pij,pj->pi", samples.frame.numpy()[chosen][..., :2], local
    )
    return drawn
