"""A trained SVG-IR model as the harness shows it: under the light that it has recovered, and relit."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run
from radiogs_core.errors import DataError
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.ply import write_ply

from .labels import labels_of
from .model import Model
from .rendering import Lit, Renderer
from .shading import bounced, limited, materials_of, reduced
from .table import Walk, table_of

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


class TrainedSVGIR:
    """Surfels with vertices and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run
        self.walk = Walk.of(run.variant, run.scene.extent)

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    def facts(self) -> dict[str, Any]:
        """``surfels``: how many. ``ratio``: the factor on kept radiance. ``labels``: what differs from the published
        method, by name (``labels_of``). ``remarks``: the same in sentences.
        """
        labels = labels_of(self.run.variant, self.run.budget, self.run.scene.extent)
        remarks = [f"{name}: {value}" for name, value in labels.items()]
        ratio = float(self.model.ratio)
        return {"surfels": len(self.model.surfels), "ratio": ratio, "labels": labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply``, each surfel with the mean material of its vertices. Raises OSError."""
        path = folder / "surfels.ply"
        write_ply(self.model.averaged(), path)
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Shaded from the table of training; or relit: a new table, whose radiance is one bounce at the first hits.

        Raises DataError for a light that is not finite.
        """
        variant, budget, model = self.run.variant, self.run.budget, self.model
        if light is None:
            table = table_of(model.cached, self.walk, budget.incident_samples, self.run.seed)
            factor = model.ratio if variant.indirect else 0.0
            own = Lit(limited(model.environment, variant.light_limit), table, factor)
            return self._shown(model.albedo, own, incident=True)
        _require_finite(light)
        device = model.albedo.device
        albedo = model.albedo if albedo_scale is None else model.albedo * albedo_scale.to(device)
        small = reduced(EnvironmentMap(light.radiance.to(device)), variant.relight_rows)
        environment = limited(small.radiance, variant.light_limit)
        table = table_of(model.surfels, self.walk, budget.relight_samples, self.run.seed)
        if variant.relight_indirect:
            materials = materials_of(model, albedo)
            table = table.with_radiance(bounced(materials, table, environment, variant.vertex_distance))
        return self._shown(albedo, Lit(environment, table, float(variant.relight_indirect)), incident=False)

    def _shown(self, albedo: Tensor, lit: Lit, incident: bool) -> "_Shown":
        materials, variant = materials_of(self.model, albedo), self.run.variant
        return _Shown(Renderer(self.model, materials, lit, variant.vertex_distance, variant.straight), incident)


def _require_finite(light: EnvironmentMap) -> None:
    broken = int((~torch.isfinite(light.radiance)).any(-1).sum())
    if broken:
        raise DataError(
            f"{broken} texels of the environment map are not finite",
            "A map is averaged before it is looked up, so each of them would spread.",
            "Repair the map's file; saturated texels are written as the format's largest finite value.",
        )


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
