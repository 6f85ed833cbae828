"""A scene, a budget and a way through a file, for tests that train for a moment."""

import io
from typing import Any

import torch

from radiogs.settings import PRESETS
from radiogs_core.plain_values import with_values
from scenes import sphere_scene

CPU = torch.device("cpu")
BUDGET = with_values(
    PRESETS["smoke"], {"geometry.steps": 24, "geometry.densify_interval": 8, "geometry.initial_surfels": 120}
)
SCENE = sphere_scene(views=4, size=16)


def through_a_file(state: dict[str, Any]) -> dict[str, Any]:
    """A checkpoint as a later process reads it."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)
