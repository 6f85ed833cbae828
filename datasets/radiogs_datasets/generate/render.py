"""Rendering one recipe with Mitsuba: radiance by path tracing, surface maps by exact intersection."""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from . import rounds, trefoil
from .disney_bsdf import PLUGIN, register
from .materials import Finish, Material, Patterned
from .probe import VARIANT
from .recipe import Pinhole, Recipe
from .solids import Box, Knot, Relief, Solid, Sphere, Turned

DIRECT_DEPTH = 2
"""Mitsuba counts the light as a vertex: depth 2 ends at the light after one surface."""

NO_ROULETTE = 100
"""A depth that no path reaches: with roulette, paths of two depths would not share their random numbers."""

SUBPIXELS = 8
"""Surface maps of a scene average SUBPIXELS x SUBPIXELS exact hits a pixel."""

MESH_CELLS = (1024, 96)
"""Cells of a knot's mesh, along and around it: neighbouring triangles differ by less than four degrees."""

ENVIRONMENT_AXES = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
"""Turns Mitsuba's Y-up map into the Z-up convention: world x = local z, y = local x, z = local y."""

OPENGL_TO_MITSUBA = np.diag([-1.0, 1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Surface:
    """The surface maps of a view, [height, width, channels]: straight values, and the coverage."""

    coverage: NDArray[np.float32]
    albedo: NDArray[np.float32]
    normal: NDArray[np.float32]
    roughness: NDArray[np.float32]
    depth: NDArray[np.float32]


def start() -> None:
    """Choose Mitsuba's variant and register the BRDF; once per process."""
    if mi.variant() != VARIANT:
        mi.set_variant(VARIANT)
        register()


def build(recipe: Recipe, environment: NDArray[np.float32]) -> mi.Scene:
    """The recipe under a light given as a lat-long map (Z up, centre column towards +X)."""
    solids = {f"solid_{place}": _solid(solid) for place, solid in enumerate(recipe.solids)}
    light = {
        "type": "envmap",
        "bitmap": mi.Bitmap(vertex_rows(environment)),
        "to_world": mi.ScalarTransform4f(ENVIRONMENT_AXES),
    }
    return mi.load_dict({"type": "scene", "light": light, **solids})


def radiance(scene: mi.Scene, camera: Pinhole, samples: int, depth: int, seed: int) -> NDArray[np.float32]:
    """Linear RGB (multiplied by alpha) and alpha, [size, size, 4].

    The same seed at two depths shares every random number up to the shallower one, so their difference is the
    deeper bounces alone, and never negative.
    """
    film = {
        "type": "hdrfilm",
        "width": camera.size,
        "height": camera.size,
        "pixel_format": "rgba",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": camera.field_of_view,
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f((camera.to_world @ OPENGL_TO_MITSUBA).tolist()),
            "film": film,
            "sampler": {"type": "multijitter", "sample_count": samples},
        }
    )
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": NO_ROULETTE, "hide_emitters": True})
    return np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=mi.UInt32(seed)))


def surface(scene: mi.Scene, camera: Pinhole, subpixels: int = SUBPIXELS) -> Surface:
    """Exact albedo, world normal, roughness and z-depth, averaged over the covered part of each pixel.

    ``subpixels`` x ``subpixels`` rays a pixel.

    The rays start at the camera itself: Mitsuba's sensor starts them on its near plane, and its distances lack that.
    """
    rays, length = _rays(camera, subpixels)
    hit = scene.ray_intersect(rays)
    met, material = hit.is_valid(), hit.bsdf()
    covered = np.array(met)[:, None]

    def average(values: NDArray) -> NDArray[np.float64]:
        blocks = np.where(covered, values, 0.0).reshape(camera.size, subpixels, camera.size, subpixels, -1)
        return blocks.mean((1, 3), dtype=np.float64)

    coverage = average(np.ones_like(length))
    share = np.where(coverage > 0, coverage, 1)
    normal = average(np.array(hit.n).T)
    norm = np.linalg.norm(normal, axis=-1, keepdims=True)
    maps = {
        "coverage": coverage,
        "albedo": average(np.array(material.eval_attribute_3("albedo", hit, met)).T) / share,
        "normal": normal / np.where(norm > 0, norm, 1),
        "roughness": average(np.array(material.eval_attribute_1("roughness", hit, met))[:, None]) / share,
        "depth": average(np.array(hit.t)[:, None] / length) / share,
    }
    return Surface(**{name: values.astype(np.float32) for name, values in maps.items()})


def any_coverage(scene: mi.Scene, camera: Pinhole, subpixels: int = SUBPIXELS) -> NDArray[np.bool_]:
    """Which pixels have any coverage in ``surface``, [size, size, 1]; a quarter of its time."""
    rays, _ = _rays(camera, subpixels)
    met = np.array(scene.ray_test(rays)).reshape(camera.size, subpixels, camera.size, subpixels)
    return met.any((1, 3))[..., None]


def vertex_rows(environment: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows resampled to 2 H + 1: Mitsuba puts its first and last row on the poles; this makes its lookup exact."""
    height = environment.shape[0]
    row = np.clip(np.linspace(0, 1, 2 * height + 1) * height - 0.5, 0, height - 1)
    above = np.minimum(np.floor(row).astype(int), height - 2)
    share = (row - above)[:, None, None]
    return ((1 - share) * environment[above] + share * environment[above + 1]).astype(np.float32)


def _rays(camera: Pinhole, subpixels: int) -> tuple[mi.Ray3f, NDArray[np.float64]]:
    """Through every subpixel, and the length of each direction of unit z-depth, [rays, 1]."""
    origins, directions = camera.rays(subpixels)
    length = np.linalg.norm(directions, axis=-1, keepdims=True)
    return mi.Ray3f(mi.Point3f(*origins.T), mi.Vector3f(*(directions / length).T)), length


def _solid(solid: Solid) -> dict[str, object] | mi.Mesh:
    bsdf = _bsdf(solid.material)
    if isinstance(solid, Sphere):
        return {"type": "sphere", "center": list(solid.centre), "radius": solid.radius, "bsdf": bsdf}
    if isinstance(solid, Box):
        low, high = np.array(solid.low), np.array(solid.high)
        placed = mi.ScalarTransform4f().translate(list((low + high) / 2)).scale(list((high - low) / 2))
        return {"type": "cube", "to_world": placed, "bsdf": bsdf}
    return _mesh(solid, bsdf)


def _mesh(solid: Knot | Turned | Relief, bsdf: dict[str, object]) -> mi.Mesh:
    """A mesh without normals at its vertices: Mitsuba shades it with its triangles' normals, so that no light leaks."""
    vertices, triangles = trefoil.mesh(solid, *MESH_CELLS) if isinstance(solid, Knot) else rounds.mesh(solid)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    made = mi.Mesh("solid", len(vertices), len(triangles), properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mi.Float(vertices.numpy().ravel())
    parameters["faces"] = mi.UInt32(triangles.numpy().ravel())
    parameters.update()
    return made


def _bsdf(finish: Finish) -> dict[str, object]:
    if not isinstance(finish, Material):
        made = texture(finish)
        return {"type": PLUGIN, "albedo": made, "roughness": made, "specular": finish.first.specular}
    return {
        "type": PLUGIN,
        "albedo": {"type": "rgb", "value": list(finish.albedo)},
        "roughness": {"type": "uniform", "value": finish.roughness},
        "specular": finish.specular,
    }


def texture(finish: Patterned) -> mi.Texture:
    """A finish as a texture, to be given to a BSDF: its colour is the albedo, its value the roughness."""

    class Solid(mi.Texture):
        def __init__(self) -> None:
            mi.Texture.__init__(self, mi.Properties())

        def eval(self, si: mi.SurfaceInteraction3f, active: mi.Bool | bool = True) -> mi.Color3f:
            return mi.Color3f(*finish.at(si.p.x, si.p.y, si.p.z, dr)[:3])

        def eval_1(self, si: mi.SurfaceInteraction3f, active: mi.Bool | bool = True) -> mi.Float:
            return finish.at(si.p.x, si.p.y, si.p.z, dr)[3]

        def is_spatially_varying(self) -> bool:
            return True

    return Solid()
