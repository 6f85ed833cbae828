"""A trained TensoIR model as the harness shows it: under the light that it has recovered, and relit."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

from .labels import labels_of
from .lighting import NewLight, RecoveredLight
from .model import Model
from .rendering import Renderer

SHOWN: Mapping[str, MapKind] = {
    "image": MapKind("display"),
    "alpha": MapKind("data"),
    "direct": MapKind("linear"),
    "indirect": MapKind("linear"),
    "albedo": MapKind("linear"),
    "roughness": MapKind("data"),
    "normal": MapKind("data"),
    "depth": MapKind("data"),
}
"""Maps of every rendering, all composited on black."""


class TrainedTensoIR:
    """A field and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.light.environment().radiance.cpu())

    def facts(self) -> dict[str, Any]:
        """``parameters``: how many numbers were learnt. ``grid``: nodes of the grid along an edge.

        ``labels``: what differs from the published method, by name (``labels_of``). ``remarks``: the same in sentences.
        """
        labels = labels_of(self.run.variant, self.run.budget)
        field = self.model.field
        count = sum(value.numel() for value in field.parameters.values()) + self.model.light.raw.numel()
        remarks = [f"{name}: {value}" for name, value in labels.items()]
        return {"parameters": count, "grid": field.size, "labels": labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``field.npz``: parameters by name, and the box's centre, radius and cells. Raises OSError."""
        path, box = folder / "field.npz", self.model.field.box
        values: dict[str, Any] = {name: value.cpu().numpy() for name, value in self.model.field.parameters.items()}
        values |= {"box_centre": box.centre.cpu().numpy(), "box_radius": np.float64(box.radius)}
        np.savez_compressed(path, **values, box_occupied=box.occupied.cpu().numpy())
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Under its own light as it was trained, or relit by direct light alone: rays are marched for each image."""
        variant, budget, field = self.run.variant, self.run.budget, self.model.field
        device = field.box.centre.device
        if light is None:
            samples = (budget.light_rows, budget.secondary_samples)
            own = RecoveredLight(self.model.light, variant, *samples, displaced=False)
            scale, shaded = torch.ones(3, device=device), variant.shown == "shaded"
            return _Shown(Renderer(field, variant, own, self.run.seed, shaded, scale))
        scale = torch.ones(3, device=device) if albedo_scale is None else albedo_scale.to(device)
        new = NewLight(
            EnvironmentMap(light.radiance.to(device)),
            budget.relight_samples,
            budget.secondary_samples,
            variant.relight_visibility,
        )
        return _Shown(Renderer(field, variant, new, self.run.seed, True, scale))


class _Shown:
    """Under one light."""

    timed = True
    default = frozenset(SHOWN)
    offers = SHOWN

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        return self.renderer.render(camera)
