"""A trained model on surfels for the harness: its maps, its export, and the labels of a run.

Training never imports this module, so that a new label or map does not invalidate trained models.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from ..contract import STANDARD_MAPS, BudgetT, MapKind, Maps, Prepared, Run
from ..scene.camera import Camera
from ..scene.light import EnvironmentMap
from ..scene.light_sampler import require_finite_light
from ..surfels.ply import write_ply
from ..surfels.starting_points import SurfelStart
from ..surfels.surfels import Surfels
from .model import SurfelModel
from .settings import SurfelVariant

ARRIVING = INCIDENT, INCIDENT_DIRECT = "incident", "incident_direct"
"""Names of the maps of mean incident radiance, indirect and direct; they are rendered on request, under the recovered
light only."""

SHOWN_WITH_INCIDENT: Mapping[str, MapKind] = {
    **STANDARD_MAPS,
    **dict.fromkeys(ARRIVING, MapKind("linear")),
}
"""Maps of a model that can also render the incident light."""

ModelT = TypeVar("ModelT", bound=SurfelModel)
V = TypeVar("V", bound=SurfelVariant)


class TrainedOnSurfels(ABC, Generic[ModelT, V, BudgetT]):
    """A model and the run that trained it; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: ModelT, run: Run[V, BudgetT], labels: Mapping[str, str]) -> None:
        self.model, self.run, self.labels = model, run, {**labels, **splat_label(run.variant.geometry.start)}

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    @property
    def surfels(self) -> Surfels:
        """The surfels that ``export`` writes."""
        return self.model.surfels

    def facts(self) -> dict[str, Any]:
        """``surfels``: their number. ``labels``: differences from the published method, by name. ``remarks``: the
        labels as sentences.
        """
        remarks = [f"{name}: {value}" for name, value in self.labels.items()]
        return {"surfels": len(self.model.surfels), "labels": self.labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply``. Raises OSError."""
        path = folder / "surfels.ply"
        write_ply(self.surfels, path)
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """The model under its recovered light (None) or relit. Raises DataError for a light that is not finite."""
        if light is None:
            return self.as_trained()
        require_finite_light(light)
        device = self.model.surfels.centre.device
        scale = torch.ones(3) if albedo_scale is None else albedo_scale
        return self.relit(EnvironmentMap(light.radiance.to(device)), scale.to(device), after_step)

    @abstractmethod
    def as_trained(self) -> Prepared:
        """The model under its recovered light."""

    @abstractmethod
    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """The model under another ``light``, which is finite and on the model's device.

        The albedo is multiplied by ``albedo_scale``. ``after_step``: see ``contract.Trained.prepare``.
        """


@runtime_checkable
class Renderer(Protocol):
    """Renders the maps of a view."""

    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps by name, [height, width, channels], on black: all maps without extra cost, and the maps of ``further``.

        image: display sRGB, clipped to [0, 1]. direct, indirect: linear outgoing radiance. incident: mean over the
        hemisphere of the indirect radiance that arrives. incident_direct: of the visible light. albedo: linear.
        roughness, alpha, depth (z-depth, world units): one channel. normal: unit, in the world; zero where nothing is
        covered.
        """


class Shown:
    """A model under one light (``contract.Prepared``): the maps of a renderer that are listed in ``offers``."""

    timed = True

    def __init__(
        self, renderer: Renderer, offers: Mapping[str, MapKind] = STANDARD_MAPS, remarks: tuple[str, ...] = ()
    ) -> None:
        self.renderer, self.offers, self.remarks = renderer, offers, remarks
        self.default = frozenset(offers).difference(ARRIVING)

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view; see ``contract.Prepared.render``."""
        wanted = self.default.union(further).intersection(self.offers)
        maps = self.renderer.render(camera, *further)
        return {name: values for name, values in maps.items() if name in wanted}


def reduced(budget: object, published: object, *names: str) -> dict[str, str]:
    """The label ``reduced``: the named fields of a budget that differ from the published values; empty if none does."""
    lower = sorted(
        f"{name} {getattr(budget, name)} (published: {getattr(published, name)})"
        for name in names
        if getattr(budget, name) != getattr(published, name)
    )
    return {"reduced": ", ".join(lower)} if lower else {}


def light_start(light: str, published: str) -> str:
    """The label of stage 2's initial light (``StartValues.light``), which also names the ``published`` light."""
    if light == "least-variation":
        return f"shared: the light of least albedo variation (published: {published})"
    return f"constant, by the images' exposure (published: {published})"


def splat_label(start: SurfelStart) -> dict[str, str]:
    """The label ``start``: the file of splats that stage 1 started from; empty if there was none."""
    if not start.splat:
        return {}
    skipped = f"without the first {100 * start.splat_skips:g} % of stage 1"
    return {"start": f"splats of a file with the SHA-256 {start.splat_sha256[:12]}..., {skipped}"}
