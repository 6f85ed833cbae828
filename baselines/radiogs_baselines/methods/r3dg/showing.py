"""Rendering of a trained R3DG model, under the recovered light and relit; labels of a run."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Prepared, Run
from radiogs_core.on_surfels.trained import ARRIVING, SHOWN_WITH_INCIDENT, Shown, TrainedOnSurfels, light_start, reduced
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.maps import incident_maps, shaded_maps

from .incident import RaySettings, VisibilityTable, arriving
from .model import Model
from .settings import PRESETS, Budget, LocalLight, Variant


class TrainedR3DG(TrainedOnSurfels[Model, Variant, Budget]):
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run[Variant, Budget]) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply`` and ``local_light.npy`` ([surfels, 16, 3], 3DGS's basis). Raises OSError."""
        local = folder / "local_light.npy"
        np.save(local, self.model.local.detach().cpu().numpy())
        return [*super().export(folder), local]

    def as_trained(self) -> Prepared:
        """Rendering under the recovered light; V is traced once for all images."""
        samples, local_light = self.run.budget.incident_samples, self.run.variant.local_light
        albedo, incident = self.model.surfels.albedo, self._arriving(samples, local_light)
        own = Renderer(self.model.surfels, albedo, incident, self.model.environment, self.run.variant.straight)
        return Shown(own, SHOWN_WITH_INCIDENT)

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """Rendering under ``light``; V is traced once, and the local light of training is kept."""
        variant, surfels = self.run.variant, self.model.surfels
        local_light: LocalLight = variant.local_light if variant.relight_local_light else "none"
        incident = self._arriving(self.run.budget.relight_samples, local_light)
        albedo = surfels.albedo.detach() * albedo_scale
        return Shown(Renderer(surfels, albedo, incident, light.radiance, variant.straight))

    @torch.no_grad()
    def _arriving(self, samples: int, local_light: LocalLight) -> Incident:
        table = VisibilityTable(self.model.surfels, RaySettings.of(self.run.variant, self.run.scene.extent), samples)
        return arriving(table, self.model.local, local_light)


class Renderer:
    """Renders surfels under one light. ``albedo`` (linear) may differ from the surfels': relighting scales it.

    The map ``indirect`` is the reflected local light, and ``incident`` the mean incident local light; both are linear.
    """

    def __init__(
        self,
        surfels: Surfels,
        albedo: Float[Tensor, "surfels 3"],
        incident: Incident,
        environment: Float[Tensor, "rows columns 3"],
        straight: bool,
    ) -> None:
        self.surfels, self.albedo, self.incident = surfels, albedo, incident
        self.environment, self.straight = environment, straight

    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps of one view; see ``on_surfels.trained.Renderer``."""
        maps = shaded_maps(camera, self.surfels, self.albedo, self.incident, self.environment, straight=self.straight)
        if set(ARRIVING).isdisjoint(further):
            return maps
        return maps | incident_maps(camera, self.surfels, self.incident, self.environment)


PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Differences from the published method, by name. ``extent``: the scene's extent, world units."""
    labels = {
        "geometry": "surfels of this project in place of 3D Gaussians with a normal of their own",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": light_start(variant.materials.start.light, "random between 0.69 and 0.97"),
        "ray_start": "one standard deviation of the surfel (published: 0.06)"
        if variant.ray_start is None
        else f"{variant.ray_start * extent:.3g} world units (published: 0.06)",
        "directions": "none below 10 degrees, as published"
        if variant.floor
        else "down to the horizon (published: to 10 degrees)",
    }
    labels |= reduced(budget, PAPER, "inverse_iterations", "incident_samples", "relight_samples", "light_height")
    if budget.local_rate != PAPER.local_rate:
        labels["local_rate"] = f"{budget.local_rate:g} times the published rates of the local light"
    return labels
