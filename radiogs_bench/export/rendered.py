"""A mesh of a trained model, from the depth and coverage that it renders: of any method that renders both."""

import statistics
from collections.abc import Callable, Sequence

import torch

from radiogs_core.contract import NotOffered, Prepared
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.scene import Scene, View

from ..scoring.maps import on_black
from .fusion import Fusion, Lattice
from .marching import zero_level
from .mesh import Mesh

FINEST = 1 / 512
"""Voxels of this share of the scene's extent, unless its images are too coarse for them. 2DGS: 1/512 of the cameras'
distance."""

FINEST_IN_PIXELS = 0.5
"""Voxels are not smaller than this share of what a pixel covers at the scene's centre: they would only interpolate."""

TRUNCATION = 4.0
"""In voxels. 2DGS takes 5; the shorter, the less do the two sides of a thin part push each other apart."""

MOST_BYTES = 2 << 30
"""Memory that voxels may take unless said otherwise."""

NEEDED = ("depth", "alpha")


def lattice_of(scene: Scene, share: float | None = None, truncation: float = TRUNCATION) -> Lattice:
    """Voxels of ``share`` of the scene's extent (None: see ``FINEST``), and a truncation in voxels.

    What is more than twice as far from a camera as the scene's centre is from the farthest one is left out. Raises
    UsageError for sizes that make no field.
    """
    farthest = 2 * max(distances(scene))
    if share is None:
        widths = (
            far / min(view.camera.fx, view.camera.fy) for far, view in zip(distances(scene), scene.train, strict=True)
        )
        voxel = max(FINEST * scene.extent, FINEST_IN_PIXELS * statistics.median(widths))
    else:
        voxel = share * scene.extent
    return Lattice(voxel, truncation * voxel, farthest)


def distances(scene: Scene) -> list[float]:
    """Of each training camera from the scene's centre, world units."""
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

    Depth maps are rendered one at a time; ``advance`` is told how many of them are done. Raises NotOffered for a model
    that renders no depth or coverage, UsageError where voxels need more than ``most_bytes``, DataError where no view
    sees a surface.
    """
    lacking = [name for name in NEEDED if name not in prepared.offers]
    if lacking:
        raise NotOffered(f"{method} renders no {' and no '.join(lacking)}", "A mesh is made from both.")
    further = [name for name in NEEDED if name not in prepared.default]
    fusion = Fusion(lattice, most_bytes)
    for done, view in enumerate(views, 1):
        camera: Camera = view.camera.to(device, torch.float32)
        maps = on_black(prepared, camera, *further, method=method, view=view.name)
        fusion.add(view.camera, maps["depth"][..., 0], maps["alpha"][..., 0])
        advance(done, len(views))
    return zero_level(fusion.blocks, lattice.voxel)
