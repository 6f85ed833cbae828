"""The yardstick of tracing: Embree's closest hit on the same surfels, two triangles each, on one core."""

from collections.abc import Callable
from importlib.util import find_spec

from .scenes import KernelScene, support_quads


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
