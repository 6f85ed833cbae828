"""A trained RadioGS model as the harness shows it: under the light that it has recovered, and relit."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.ply import write_ply
from radiogs_core.surfels.surfels import Surfels

from .model import Model
from .relighting import Relit, relit_under, training_share
from .rendering import Renderer
from .varying import VaryingRadioGS

SHADED: Mapping[str, MapKind] = {
    "image": MapKind("display"),
    "alpha": MapKind("data"),
    "direct": MapKind("linear"),
    "indirect": MapKind("linear"),
    "albedo": MapKind("linear"),
    "roughness": MapKind("data"),
    "normal": MapKind("data"),
    "depth": MapKind("data"),
}
"""Maps of a model that is shaded, all composited on black."""

INCIDENT: Mapping[str, MapKind] = {"incident": MapKind("linear")}
"""The mean indirect radiance that arrives, which costs a pass of its own."""


class TrainedRadioGS:
    """Surfels with materials and a light, and what they were trained on; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    @property
    def surfels(self) -> Surfels:
        """The surfels."""
        return self.model.surfels

    def facts(self) -> dict[str, Any]:
        """``surfels``: how many. ``effects``: the plan when training ended, and the evidence for it, oldest first.

        ``metrics``: ``plan/bound`` and ``plan/worst``, dB that the plan costs at most, by the probe that says most; 0
        where no probe has left anything out. ``remarks``: what is not simulated, in words. ``given``: the parts of the
        truth that training was given, and how far the given indirect light is from solved (``KnownRadiance``).
        """
        plan, evidence = self.model.plan, [dict(each) for each in self.model.evidence]
        measured = [each["measured"] for each in evidence if each["effect"] == "plan" and each["measured"] is not None]
        indirect, parts = self.model.indirect, list(self.run.variant.given)
        residual = {} if indirect is None else {"indirect_residual": indirect.residual}
        return {
            **({"given": {"parts": parts, **residual}} if parts else {}),
            "surfels": len(self.model.surfels),
            "effects": {"plan": plan.plain(), "evidence": evidence},
            "metrics": {
                f"plan/{name}": max((each[name] for each in measured), default=0.0) for name in ("bound", "worst")
            },
            "remarks": [f"not, or only in part, simulated: {', '.join(plan.off)}"] if plan.off else [],
        }

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
        """Shaded as it was trained, or relit in the mode of the variant (``relighting``)."""
        if light is None:
            return _Own(Renderer(self.model, self.run.budget.incident_samples, self.run.variant))
        scale = torch.ones(3) if albedo_scale is None else albedo_scale
        share = self.training_share if self.run.variant.effects == "auto" else None
        relit = relit_under(self.model, light, scale, self.run, after_step, share)
        return _Relit(relit, surfels_alone=self.run.variant.relighting == "surfels")

    def varying(self, cameras: Sequence[Camera]) -> VaryingRadioGS:
        """Under its own light, with roughness or brightness changed; see ``radiogs_core.capabilities.Variable``."""
        renderer = Renderer(self.model, self.run.budget.incident_samples, self.run.variant)
        return VaryingRadioGS(renderer, cameras, self.run.variant.given)

    @cached_property
    def training_share(self) -> Float[Tensor, " surfels"]:
        """The part of the training images that each surfel is; the same for every light."""
        return training_share(self.run.scene, self.model.surfels)


class _Own:
    """Under the light that it was trained in."""

    timed = True
    default = frozenset(SHADED)

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.offers: Mapping[str, MapKind] = {**SHADED, **(INCIDENT if renderer.incident is not None else {})}

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        maps = self.renderer.render(camera)
        return maps | {"incident": self.renderer.incident_map(camera)} if "incident" in further else maps


class _Relit:
    """Under another light. ``remarks``: what was decided by evidence, and why, in words."""

    timed = True

    def __init__(self, relit: Relit, surfels_alone: bool) -> None:
        self.relit = relit
        self.remarks = tuple(f"{each.effect}: {each.verdict} ({each.why})" for each in relit.evidence)
        shown = ("image", "alpha") if surfels_alone else tuple(SHADED)
        self.offers: Mapping[str, MapKind] = {name: SHADED[name] for name in shown}
        self.default = frozenset(self.offers)

    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        return self.relit.render(camera)
