"""Distance between a recovered and a true shape."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from radiogs_core.errors import DataError

SAMPLES = 30_000
"""Points that Stanford-ORB draws from the recovered surface."""

Triangles = Int[np.ndarray, "faces 3"]


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
