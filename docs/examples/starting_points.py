"""How far the points that surfels start from lie from the true surfaces, for several ways of sweeping depth.

    python docs/examples/starting_points.py [SCENE ...]

Prints, for each scene whose surfaces are known: the distance of the points from the nearest surface, mean and 90 %
quantile, and the mean distance of the surface from the nearest point, all in percent of the scene's extent.
"""

import sys
from collections.abc import Mapping

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.starting_points import SurfelStart, initial_surfels
from radiogs_core.surfels.swept_depth import DepthSweep
from radiogs_datasets import load_scene

COUNT = 6000
"""Surfels, as preset tiny starts with."""

FINE = 0.005
"""Distance between samples of the true surfaces, in scene extents."""

WAYS: Mapping[str, SurfelStart] = {
    "hull": SurfelStart(points="hull"),
    "swept": SurfelStart(),
    "swept, points not fused": SurfelStart(sweep=DepthSweep(fusions=0)),
    "swept, 3 of the 8 nearest views agree": SurfelStart(sweep=DepthSweep(neighbours=8, agreeing=3)),
    "swept, 6 of 8": SurfelStart(sweep=DepthSweep(neighbours=8, agreeing=6)),
    "swept, 8 of 24": SurfelStart(sweep=DepthSweep(neighbours=24, agreeing=8)),
    "swept, changes of depth by a plane cost four times as much": SurfelStart(sweep=DepthSweep(step=0.005)),
}


def distances(points: Tensor, others: Tensor) -> Tensor:
    """From each point to the nearest of the others, world units."""
    return torch.from_numpy(cKDTree(others.double().numpy()).query(points.double().numpy())[0])


def report(scene: Scene) -> None:
    """Print one line for each way to start."""
    surface = scene.true_surfaces(FINE * scene.extent).centre
    for name, start in WAYS.items():
        generator = torch.Generator().manual_seed(0)
        points = initial_surfels(scene, scene.train, COUNT, start, True, generator).centre
        off, bare = (100 * each / scene.extent for each in (distances(points, surface), distances(surface, points)))
        values = f"{off.mean():.2f} {off.quantile(0.9):.2f} {bare.mean():.2f}"
        sys.stdout.write(f"{scene.name}: {values}  {name} ({len(points)} points)\n")


if __name__ == "__main__":
    for each in sys.argv[1:] or ["corner", "bowl", "niche"]:
        report(load_scene(each))
