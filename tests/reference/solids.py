"""What a camera sees of a recipe's solids, in float64, sharing no code: boxes and spheres by closed form, knots by
marching along rays by the distance to the tube."""

import numpy as np
from scipy.spatial import cKDTree

from radiogs_datasets.generate.recipe import Recipe
from radiogs_datasets.generate.solids import Box, Knot

FAR = 1e9


def cast(recipe: Recipe, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
    """Along rays [..., 3]: number of the nearest solid (-1: none), distance in lengths of the direction, normal."""
    solid = np.full(directions.shape[:-1], -1)
    distance = np.full(directions.shape[:-1], FAR)
    normal = np.zeros(directions.shape)
    for number, shape in enumerate(recipe.solids):
        met = _box if isinstance(shape, Box) else _knot if isinstance(shape, Knot) else _sphere
        found, face = met(shape, origin, directions)
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
    flat = directions.reshape(-1, 3)
    length = np.linalg.norm(flat, axis=-1)
    ball = shape.ring + shape.swing + shape.radius
    offset = origin - np.array(shape.centre)
    middle = -(flat @ offset) / length  # where the ray is nearest to the knot's middle, in world units
    beside = offset @ offset - middle**2
    going = np.flatnonzero(beside < ball**2)
    travelled = np.maximum(middle - np.sqrt(np.maximum(ball**2 - beside, 0)), 0)
    near, normal = np.full(len(flat), FAR), np.zeros_like(flat)
    while len(going):
        point = origin + travelled[going, None] * flat[going] / length[going, None]
        distance, place = tree.query(point)
        there = distance - shape.radius < 1e-6
        met = going[there]
        near[met] = travelled[met] / length[met]
        normal[met] = (point[there] - curve[place[there]]) / distance[there, None]
        travelled[going] += distance - shape.radius
        going = going[~there & (travelled[going] < middle[going] + ball)]
    return near.reshape(directions.shape[:-1]), normal.reshape(directions.shape)
