"""A scene, a budget and a way through a file, for tests that train for a moment."""

import io
from collections.abc import Callable
from typing import Any

import torch

from radiogs.settings import PRESETS
from radiogs_core.plain_values import with_values
from scenes import sphere_scene

CPU = torch.device("cpu")
BUDGET = with_values(
    PRESETS["smoke"], {"geometry.steps": 24, "geometry.densify_interval": 8, "geometry.initial_surfels": 120}
)
PROBED = with_values(BUDGET, {"inverse_iterations": 20_000, "incident_samples": 32})
"""A budget in which rays are most of the planned work, so that probes pay."""
SCENE = sphere_scene(views=4, size=16)


def through_a_file(state: dict[str, Any]) -> dict[str, Any]:
    """A checkpoint as a later process reads it."""
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    return torch.load(file, weights_only=True)


def resumed(begin: Callable[[], Any], saved: int, end: int) -> tuple[Any, Any]:
    """Two stages at step ``end``: one trained in one go, the other from a checkpoint of the first at step ``saved``."""
    whole, again = begin(), begin()
    for step in range(end):
        if step == saved:
            again.restore(through_a_file(whole.state()))
        whole.step()
    while again.iteration < end:
        again.step()
    return whole, again


def same_tensors(first: Any, second: Any) -> bool:
    """Whether two stages have learnt the same to the last bit."""
    mine, yours = first.optimiser.tensors, second.optimiser.tensors
    return mine.keys() == yours.keys() and all(torch.equal(mine[name], yours[name]) for name in mine)
