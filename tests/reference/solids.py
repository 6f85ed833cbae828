"""The image of a recipe's solids in a camera, in float64, sharing no code: boxes and spheres by closed form, knots and
solids of revolution by marching along rays by the distance to the surface, reliefs by their height above it."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

from radiogs_datasets.generate.recipe import Recipe
from radiogs_datasets.generate.solids import Box, Knot, Relief, Solid, Sphere, Turned

FAR = 1e9


def cast(recipe: Recipe, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
    """Along rays [..., 3]: number of the nearest solid (-1: none), distance in lengths of the direction, normal."""
    solid = np.full(directions.shape[:-1], -1)
    distance = np.full(directions.shape[:-1], FAR)
    normal = np.zeros(directions.shape)
    for number, shape in enumerate(recipe.solids):
        found, face = MET[type(shape)](shape, origin, directions)
        nearer = found < distance
        solid[nearer], distance[nearer], normal[nearer] = number, found[nearer], face[nearer]
    return solid, distance, normal


def _sphere(shape, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    offset = origin - np.array(shape.centre)
    a, b = (directions**2).sum(-1), directions @ offset
    discriminant = b**2 - a * (offset @ offset - shape.radius**2)
    near = (-b - np.sqrt(np.maximum(discriminant, 0))) / a
    return np.where(discriminant > 0, near, FAR), (offset + near[..., None] * directions) / shape.radius


def _box(shape, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    slabs = (np.array([shape.low, shape.high])[:, None] - origin) / directions.reshape(-1, 3)
    entry, leave = slabs.min(0), slabs.max(0).min(-1)
    axis = entry.argmax(-1)
    near = entry.max(-1)
    face = -np.sign(directions.reshape(-1, 3)) * np.eye(3)[axis]
    near = np.where(near < leave, near, FAR)
    return near.reshape(directions.shape[:-1]), face.reshape(directions.shape)


def knot_curve(shape: Knot, count: int) -> np.ndarray:
    """Points on the middle of a knot's tube, [count, 3]."""
    t = np.arange(count) * (2 * np.pi / count)
    torus = np.stack([np.cos(2 * t) * np.cos(3 * t), np.sin(2 * t) * np.cos(3 * t), np.sin(3 * t)], -1)
    ring = np.stack([np.cos(2 * t), np.sin(2 * t), np.zeros_like(t)], -1)
    return np.array(shape.centre) + shape.ring * ring + shape.swing * torus


def _knot(shape: Knot, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    curve = knot_curve(shape, 20_000)
    tree = cKDTree(curve)

    def beyond(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point = offset + shape.centre
        distance, place = tree.query(point)
        return distance - shape.radius, (point - curve[place]) / distance[:, None]

    return _marched(shape, origin, directions, shape.ring + shape.swing + shape.radius, beyond, 1e-6)


def profile_curve(shape: Turned, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (distance from the axis, height above the centre) of a profile, and its unit outward normals."""
    points = np.array(shape.profile)
    mirrored = points * [-1, 1]
    spline = BSpline(np.arange(len(points) + 8), np.concatenate([mirrored[1::-1], points, mirrored[:-3:-1]]), 3)
    place = np.linspace(3.5, len(points) + 3.5, count)
    along = spline(place, 1)
    return spline(place), np.stack([along[:, 1], -along[:, 0]], -1) / np.linalg.norm(along, axis=-1, keepdims=True)


def _turned(shape: Turned, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    curve, outwards = profile_curve(shape, 20_000)
    tree = cKDTree(curve)

    def beyond(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        away = np.linalg.norm(offset[:, :2], axis=-1)
        distance, place = tree.query(np.stack([away, offset[:, 2]], -1))
        flat = outwards[place, :1] * offset[:, :2] / away[:, None]
        return distance, np.concatenate([flat, outwards[place, 1:]], -1)

    # Between the points of the curve no distance is zero.
    return _marched(shape, origin, directions, float(np.linalg.norm(curve, axis=-1).max()), beyond, 4e-4)


def relief_radius(shape: Relief, direction: np.ndarray) -> np.ndarray:
    """Distance of a relief's surface from its centre along unit directions [..., 3]."""
    total = np.ones(direction.shape[:-1])
    for swell in shape.swells:
        azimuth, elevation = np.radians([swell.azimuth, swell.elevation])
        middle = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        total += swell.height * np.exp(swell.sharpness * (direction @ middle - 1))
    random = np.random.default_rng(shape.seed).random((24, 3))
    length = np.geomspace(shape.longest, shape.shortest, 24)
    height = 2 * random[:, 0] - 1
    azimuth = 2 * np.pi * random[:, 1]
    flat = np.sqrt(1 - height**2)
    wave = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), height], -1) / length[:, None]
    waves = np.sin(2 * np.pi * (direction @ wave.T + random[:, 2]))
    return shape.radius * (total + shape.ripple * (waves * np.sqrt(2 * length / length.sum())).sum(-1))


def relief_height(shape: Relief, offset: np.ndarray) -> np.ndarray:
    """How much farther from the centre than a relief's surface points [..., 3] relative to the centre are."""
    distance = np.linalg.norm(offset, axis=-1)
    return distance - relief_radius(shape, offset / distance[..., None])


def _relief(shape: Relief, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    steps = 1e-5 * np.eye(3)

    def beyond(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # A part of the height is less than the distance, as slopes are bounded.
        return 0.44 * relief_height(shape, offset), np.zeros_like(offset)

    bulge = sum(max(swell.height, 0.0) for swell in shape.swells)
    ball = shape.radius * (1 + bulge + 6 * shape.ripple)
    near, normal = _marched(shape, origin, directions, ball, beyond, 1e-6)
    met = near < FAR
    offset = origin - np.array(shape.centre) + near[met, None] * directions[met]
    slope = np.stack([relief_height(shape, offset + step) - relief_height(shape, offset - step) for step in steps], -1)
    normal[met] = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    return near, normal


def _marched(
    shape: Knot | Turned | Relief,
    origin: np.ndarray,
    directions: np.ndarray,
    ball: float,
    beyond: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Steps through the ball around a solid's centre, each as far as ``beyond`` says of a point that nothing is met.

    ``beyond`` is given points relative to the centre; it also returns normals.
    """
    flat = directions.reshape(-1, 3)
    length = np.linalg.norm(flat, axis=-1)
    offset = origin - np.array(shape.centre)
    middle = -(flat @ offset) / length  # where the ray is nearest to the solid's middle, in world units
    beside = offset @ offset - middle**2
    going = np.flatnonzero(beside < ball**2)
    travelled = np.maximum(middle - np.sqrt(np.maximum(ball**2 - beside, 0)), 0)
    near, normal = np.full(len(flat), FAR), np.zeros_like(flat)
    while len(going):
        distance, outwards = beyond(offset + travelled[going, None] * flat[going] / length[going, None])
        there = distance < tolerance
        met = going[there]
        near[met] = travelled[met] / length[met]
        normal[met] = outwards[there]
        travelled[going] += distance
        going = going[~there & (travelled[going] < middle[going] + ball)]
    return near.reshape(directions.shape[:-1]), normal.reshape(directions.shape)


MET: dict[type[Solid], Callable[..., tuple[np.ndarray, np.ndarray]]] = {
    Box: _box, Sphere: _sphere, Knot: _knot, Turned: _turned, Relief: _relief,
}  # fmt: skip
