"""A trained R3DG model as the harness shows it: under the light that it has recovered, and relit."""

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
from radiogs_core.surfels.ply import write_ply
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import require_finite_light
from radiogs_core.transport.splatting import incident_map, shaded_maps

from .labels import labels_of
from .local_light import arriving
from .model import Model
from .visibility import Rays, VisibilityTable

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
"""Maps of every rendering, all composited on black; ``indirect`` is what the local light makes surfels send out."""

INCIDENT = "incident"
"""The mean local light that arrives, which is kept where it is asked for; under the recovered light alone."""


class TrainedR3DG:
    """Surfels with materials, a light and local light, and what they were trained on; see ``contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light from afar, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    def facts(self) -> dict[str, Any]:
        """``surfels``: how many. ``labels``: what differs from the published method, by name (``labels_of``).

        ``remarks``: the same in sentences.
        """
        labels = labels_of(self.run.variant, self.run.budget, self.run.scene.extent)
        remarks = [f"{name}: {value}" for name, value in labels.items()]
        return {"surfels": len(self.model.surfels), "labels": labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply`` and ``local_light.npy`` ([surfels, 16, 3], 3DGS's basis). Raises OSError."""
        surfels, local = folder / "surfels.ply", folder / "local_light.npy"
        write_ply(self.model.surfels, surfels)
        np.save(local, self.model.local.detach().cpu().numpy())
        return [surfels, local]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Shaded as it was trained, or relit: V is traced once, and the local light stays what it was in training."""
        variant, budget, surfels = self.run.variant, self.run.budget, self.model.surfels
        if light is None:
            return self._under(self.model.environment, surfels.albedo, budget.incident_samples, True)
        require_finite_light(light)
        scale = torch.ones(3) if albedo_scale is None else albedo_scale
        albedo = surfels.albedo.detach() * scale.to(surfels.centre.device)
        environment = light.radiance.to(surfels.centre.device)
        return self._under(environment, albedo, budget.relight_samples, variant.relight_local_light, relit=True)

    @torch.no_grad()
    def _under(
        self, environment: Tensor, albedo: Tensor, samples: int, with_local_light: bool, relit: bool = False
    ) -> "_Shown":
        variant, surfels = self.run.variant, self.model.surfels
        table = VisibilityTable(surfels, Rays.of(variant, self.run.scene.extent), samples)
        incident = arriving(table, self.model.local, variant.local_light if with_local_light else "none")
        return _Shown(surfels, albedo, incident, environment, variant.straight, relit)


class _Shown:
    """Under one light; ``albedo`` is given apart, because relighting scales it."""

    timed = True
    default = frozenset(SHOWN)

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        incident: Incident,
        environment: Float[Tensor, "rows columns 3"],
        straight: bool,
        relit: bool,
    ) -> None:
        self.surfels, self.albedo, self.incident = surfels, albedo, incident
        self.environment, self.straight = environment, straight
        self.offers: Mapping[str, MapKind] = {**SHOWN, **({} if relit else {INCIDENT: MapKind("linear")})}

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        maps = shaded_maps(camera, self.surfels, self.albedo, self.incident, self.environment, straight=self.straight)
        if INCIDENT in further and INCIDENT in self.offers:
            maps[INCIDENT] = incident_map(camera, self.surfels, self.incident)
        return maps
