"""The surfels of a trained model as arrays that are kept with its result, for the report's 3-D view."""

from typing import Protocol, runtime_checkable

import numpy as np
import torch

from radiogs_core.contract import Trained
from radiogs_core.scene.initial_viewpoint import InitialViewpoint
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels

MOST = 50_000
"""Surfels of a larger model that are kept: those that cover most, by area times opacity. About 2 MB."""


@runtime_checkable
class MadeOfSurfels(Protocol):
    """A trained model that can be shown in 3-D, as the surfels that it exports."""

    @property
    def surfels(self) -> Surfels:
        """Its surfels, with the materials that other programs get."""


def surfel_arrays(model: Trained, seen_from: InitialViewpoint) -> dict[str, np.ndarray]:
    """Arrays of at most ``MOST`` surfels by name; empty for a model that is not made of surfels, or has none left.

    ``surfels/centre`` [N, 3] and ``surfels/tangents`` [N, 2, 3], scaled by their standard deviations, float32, world
    units; ``surfels/opacity`` [N], ``surfels/radiance`` (mean over directions) and ``surfels/albedo`` [N, 3], linear,
    and ``surfels/roughness`` [N], float16; ``surfels/count`` [1], how many the model has; ``surfels/eye``,
    ``surfels/up``, ``surfels/middle`` [3] and ``surfels/arc`` [2], from where it is seen (``InitialViewpoint``; the
    last two where it has them).
    """
    if not isinstance(model, MadeOfSurfels) or not len(model.surfels):
        return {}
    return arrays_of(model.surfels, seen_from)


def arrays_of(surfels: Surfels, seen_from: InitialViewpoint) -> dict[str, np.ndarray]:
    """The arrays of ``surfel_arrays`` of at least one surfel."""
    with torch.no_grad():
        viewpoint = {name: np.array(value, np.float32) for name, value in seen_from.plain().items()}
        return {f"surfels/{name}": values for name, values in {**_arrays(surfels), **viewpoint}.items()}


def _arrays(surfels: Surfels) -> dict[str, np.ndarray]:
    kept = (surfels.opacity * surfels.scale.prod(-1)).argsort(descending=True, stable=True)[:MOST]
    any_direction = torch.tensor([0.0, 0.0, 1.0], device=surfels.centre.device).expand_as(surfels.centre)
    tangents = surfels.frame[..., :2].mT * surfels.scale[..., None]
    shown = {
        "opacity": surfels.opacity,
        "radiance": surfel_radiance(surfels.sh[:, :1], any_direction),
        "albedo": surfels.albedo,
        "roughness": surfels.roughness,
    }
    largest = torch.finfo(torch.float16).max
    arrays = {name: values[kept].clamp(max=largest).half().cpu().numpy() for name, values in shown.items()}
    arrays["centre"], arrays["tangents"] = surfels.centre[kept].cpu().numpy(), tangents[kept].cpu().numpy()
    arrays["count"] = np.array([len(surfels)], dtype=np.float32)
    return arrays
