"""Rendering one recipe with Mitsuba: radiance by path tracing, surface maps by exact intersection."""

# Mitsuba's types exist only once a variant is set, so annotations must not be evaluated here.
from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from .catalogue import Box, Recipe, Sphere
from .disney_bsdf import PLUGIN, register
from .probe import VARIANT

GLOBAL_DEPTH = 8
DIRECT_DEPTH = 2
"""Mitsuba counts the light as a vertex: depth 2 ends at the light after one surface."""

NO_ROULETTE = 100
SUBPIXELS = 8
"""Surface maps average SUBPIXELS x SUBPIXELS exact hits a pixel."""

ENVIRONMENT_AXES = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
"""Turns Mitsuba's Y-up map into the Z-up convention: world x = local z, y = local x, z = local y."""


@dataclass(frozen=True)
class Surface:
    """What a view sees, [height, width, channels]: straight values, and the coverage they stand for."""

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
        "bitmap": mi.Bitmap(_vertex_rows(environment)),
        "to_world": mi.ScalarTransform4f(ENVIRONMENT_AXES),
    }
    return mi.load_dict({"type": "scene", "light": light, **solids})


def radiance(
    scene: mi.Scene, camera: NDArray[np.float64], field_of_view: float, size: int, samples: int, depth: int, seed: int
) -> NDArray[np.float32]:
    """Linear RGB (multiplied by alpha) and alpha, [size, size, 4]; ``camera`` is camera-to-world, OpenGL axes.

    The same seed at two depths shares every random number up to the shallower one, so their difference is the
    deeper bounces alone, and never negative.
    """
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": field_of_view,
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(camera @ np.diag([-1.0, 1.0, -1.0, 1.0])),
            "film": {
                "type": "hdrfilm", "width": size, "height": size, "pixel_format": "rgba",
                "component_format": "float32", "rfilter": {"type": "box"},
            },
            "sampler": {"type": "multijitter", "sample_count": samples},
        }
    )  # fmt: skip
    integrator = mi.load_dict(
        {"type": "path", "max_depth": depth, "rr_depth": NO_ROULETTE, "hide_emitters": True}
    )
    return np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=seed))


def surface(scene: mi.Scene, recipe: Recipe, camera: NDArray[np.float64], field_of_view: float, size: int) -> Surface:
    """Exact albedo, world normal, roughness and z-depth, averaged over the covered part of each pixel."""
    fine = size * SUBPIXELS
    focal = 0.5 * fine / np.tan(np.radians(field_of_view) / 2)
    column, row = np.meshgrid(np.arange(fine) + 0.5 - fine / 2, np.arange(fine) + 0.5 - fine / 2)
    local = np.stack([column / focal, -row / focal, -np.ones_like(row)], -1).reshape(-1, 3)
    length = np.linalg.norm(local, axis=-1)
    world = (local / length[:, None]) @ camera[:3, :3].T
    origin = np.broadcast_to(camera[:3, 3], world.shape)
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*origin.T), mi.Vector3f(*world.T)))
    met = np.array(hit.is_valid())
    shapes = dr.reinterpret_array(mi.UInt32, hit.shape)
    known = {int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0]): shape.id() for shape in scene.shapes()}
    numbers = np.array([_number(known.get(int(value), "")) for value in np.array(shapes)])
    albedo = np.array([solid.material.albedo for solid in recipe.solids] + [(0.0, 0.0, 0.0)])[numbers]
    roughness = np.array([[solid.material.roughness] for solid in recipe.solids] + [[0.0]])[numbers]
    normal = np.array(hit.n).T
    depth = (np.array(hit.t) / length)[:, None]
    coverage = met.astype(np.float64)[:, None]

    def average(values: NDArray) -> NDArray:
        return np.where(met[:, None], values, 0).reshape(size, SUBPIXELS, size, SUBPIXELS, -1).mean((1, 3))

    share = average(coverage)
    straight = [average(values) / np.where(share > 0, share, 1) for values in (albedo, normal, roughness, depth)]
    norm = np.linalg.norm(straight[1], axis=-1, keepdims=True)
    straight[1] = straight[1] / np.where(norm > 0, norm, 1)
    return Surface(share.astype(np.float32), *(values.astype(np.float32) for values in straight))


def _number(identity: str) -> int:
    return int(identity.removeprefix("solid_")) if identity.startswith("solid_") else -1


def _solid(solid: Box | Sphere) -> dict[str, object]:
    bsdf = {
        "type": PLUGIN,
        "albedo": {"type": "rgb", "value": list(solid.material.albedo)},
        "roughness": {"type": "uniform", "value": solid.material.roughness},
    }
    if isinstance(solid, Sphere):
        return {"type": "sphere", "center": list(solid.centre), "radius": solid.radius, "bsdf": bsdf}
    low, high = np.array(solid.low), np.array(solid.high)
    placed = mi.ScalarTransform4f().translate(list((low + high) / 2)).scale(list((high - low) / 2))
    return {"type": "cube", "to_world": placed, "bsdf": bsdf}


def _vertex_rows(environment: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows resampled to 2 H + 1: Mitsuba puts its first and last row on the poles; this makes its lookup exact."""
    height = environment.shape[0]
    row = np.clip(np.linspace(0, 1, 2 * height + 1) * height - 0.5, 0, height - 1)
    above = np.minimum(np.floor(row).astype(int), height - 2)
    share = (row - above)[:, None, None]
    return ((1 - share) * environment[above] + share * environment[above + 1]).astype(np.float32)
