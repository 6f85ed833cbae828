"""What a camera sees of a recipe's boxes and spheres: closed-form intersection in float64, sharing no code."""

import numpy as np

from radiogs_datasets.generate.recipe import Recipe
from radiogs_datasets.generate.solids import Box, Knot

FAR = 1e9


def cast(recipe: Recipe, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
    """Along rays [..., 3]: number of the nearest solid (-1: none), distance in lengths of the direction, normal."""
    solid = np.full(directions.shape[:-1], -1)
    distance = np.full(directions.shape[:-1], FAR)
    normal = np.zeros(directions.shape)
    for number, shape in enumerate(recipe.solids):
        found, face = _box(shape, origin, directions) if isinstance(shape, Box) else _sphere(shape, origin, directions)
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
