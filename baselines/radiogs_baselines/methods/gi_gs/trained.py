"""A trained GI-GS model as the harness shows it: under the light that it has recovered, and relit."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.ply import write_ply
from radiogs_core.transport.sampling import require_finite_light

from .grid import Grid
from .labels import labels_of
from .lighting import SplitSumLight
from .marching import March
from .model import Model
from .rendering import Renderer
from .shading import Shader

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

INCIDENT = "incident"
"""The mean indirect radiance that arrives, which is kept where it is asked for; under the recovered light alone."""


class TrainedGIGS:
    """Surfels with materials and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    def facts(self) -> dict[str, Any]:
        """``surfels``: how many. ``labels``: what differs from the published method, by name (``labels_of``).

        ``remarks``: the same in sentences.
        """
        labels = labels_of(self.run.variant, self.run.budget, self.run.scene.extent)
        remarks = [f"{name}: {value}" for name, value in labels.items()]
        return {"surfels": len(self.model.surfels), "labels": labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply``. Raises OSError."""
        path = folder / "surfels.ply"
        write_ply(self.model.surfels, path)
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Shaded as in training, or relit: without occlusion, and with the bounce of the frame under the new light.

        Raises DataError for a light that is not finite.
        """
        variant, albedo = self.run.variant, self.model.surfels.albedo.detach()
        if light is None:
            own = self._shader(variant.occlusion, variant.indirect)
            return _Shown(Renderer(self.model, albedo, SplitSumLight(self.model.environment), own), incident=True)
        require_finite_light(light)
        scale = torch.ones(3) if albedo_scale is None else albedo_scale
        new = SplitSumLight(light.radiance.to(albedo.device), variant.frame)
        shader = self._shader(occlusion=False, indirect=variant.relight_indirect)
        return _Shown(Renderer(self.model, albedo * scale.to(albedo.device), new, shader), incident=False)

    def _shader(self, occlusion: bool, indirect: bool) -> Shader:
        variant, budget = self.run.variant, self.run.budget
        grid = Grid.of(budget.render_azimuths, budget.render_heights)
        march = March.of(grid, variant, budget.march_steps, self.run.scene.extent, variant.start)
        return Shader(march, occlusion, indirect, variant.sum, variant.straight)


class _Shown:
    """Under one light."""

    timed = True
    default = frozenset(SHOWN)

    def __init__(self, renderer: Renderer, incident: bool) -> None:
        self.renderer = renderer
        self.offers: Mapping[str, MapKind] = {**SHOWN, **({INCIDENT: MapKind("linear")} if incident else {})}

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        wanted = self.default.union(further).intersection(self.offers)
        return {name: values for name, values in self.renderer.render(camera).items() if name in wanted}
