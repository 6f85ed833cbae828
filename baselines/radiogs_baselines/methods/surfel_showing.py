"""A trained model on shared surfels as the harness shows it: what is the same, whatever shades them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.ply import write_ply
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import require_finite_light

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


@runtime_checkable
class LitSurfels(Protocol):
    """What is recovered: surfels, and the linear radiance of the light that they were seen under."""

    @property
    def surfels(self) -> Surfels:
        """The surfels."""

    @property
    def environment(self) -> Float[Tensor, "height width 3"]:
        """Linear radiance, lat-long (see ``scene.light``)."""


Model = TypeVar("Model", bound=LitSurfels)


class TrainedOnSurfels(ABC, Generic[Model]):
    """A model, and what it was trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run, labels: Mapping[str, str]) -> None:
        self.model, self.run, self.labels = model, run, dict(labels)

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    def facts(self) -> dict[str, Any]:
        """``surfels``: how many. ``labels``: what differs from the published method, by name (``labels_of``).

        ``remarks``: the same in sentences.
        """
        remarks = [f"{name}: {value}" for name, value in self.labels.items()]
        return {"surfels": len(self.model.surfels), "labels": self.labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply``. Raises OSError."""
        path = folder / "surfels.ply"
        write_ply(self.surfels, path)
        return [path]

    @property
    def surfels(self) -> Surfels:
        """The surfels that other programs get."""
        return self.model.surfels

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Shaded as it was trained, or relit. Raises DataError for a light that is not finite."""
        if light is None:
            return self.as_trained()
        require_finite_light(light)
        device = self.model.surfels.centre.device
        scale = torch.ones(3) if albedo_scale is None else albedo_scale
        return self.relit(EnvironmentMap(light.radiance.to(device)), scale.to(device))

    @abstractmethod
    def as_trained(self) -> Prepared:
        """Under the recovered light."""

    @abstractmethod
    def relit(self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"]) -> Prepared:
        """Under another light, which is finite and on the model's device; albedo is multiplied by ``albedo_scale``."""


@runtime_checkable
class Renderer(Protocol):
    """Draws all maps of a view."""

    def render(self, camera: Camera) -> Maps:
        """Maps by name."""


class Shown:
    """Under one light: of what a renderer draws, the maps that are asked for. ``incident``: whether that is offered."""

    timed = True
    default = frozenset(SHOWN)

    def __init__(self, renderer: Renderer, incident: bool = False) -> None:
        self.renderer = renderer
        self.offers: Mapping[str, MapKind] = {**SHOWN, **({INCIDENT: MapKind("linear")} if incident else {})}

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        wanted = self.default.union(further).intersection(self.offers)
        return {name: values for name, values in self.renderer.render(camera).items() if name in wanted}
