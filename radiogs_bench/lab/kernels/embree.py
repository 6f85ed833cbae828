"""The yardstick of tracing: Embree's closest hit on the same surfels, two triangles each, on one core."""

from collections.abc import Callable
from importlib.util import find_spec

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.surfel.support import support_of

from .scenes import KernelScene


def missing_embree() -> str:
    """Why Embree is not available; empty if it is."""
    return "" if find_spec("embreex") else "Embree is not installed (pip install embreex)"


def closest_hits(scene: KernelScene) -> Callable[[], object]:
    """A function that finds the closest hit of every ray; it does not blend, and hits back sides too."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    corners, triangles = support_quads(scene.geometry)
    embree = EmbreeScene()
    TriangleMesh(embree, corners.numpy(), triangles.numpy())
    origin = (scene.origin + scene.t_min[:, None] * scene.direction).numpy()
    direction = scene.direction.numpy()
    return lambda: embree.run(origin, direction)


def support_quads(geometry: SplatGeometry) -> tuple[Float[Tensor, "corners 3"], Int[Tensor, "triangles 3"]]:
    """Every surfel's support as the square around its ellipse, in two triangles."""
    reach = support_of(geometry).radius[:, None]
    along_u, along_v = (
        reach * axis / axis.square().sum(-1, keepdim=True) for axis in (geometry.axis_u, geometry.axis_v)
    )
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = torch.stack([geometry.centre + u * along_u + v * along_v for u, v in signs], 1)
    first = 4 * torch.arange(len(geometry), dtype=torch.int32)[:, None]
    halves = [first + torch.tensor([half], dtype=torch.int32) for half in ((0, 1, 2), (0, 2, 3))]
    return corners.flatten(0, 1), torch.cat(halves)
