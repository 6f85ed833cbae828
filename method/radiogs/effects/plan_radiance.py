"""Radiance of surfels under different plans, along the same directions, so that differences have no sampling noise."""

from dataclasses import replace
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.kernels.rasterize.projection import Projection
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels, roughness_to_logit
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.shading import lambert_albedo
from radiogs_core.transport.splatting import (
    DIFFUSE_DIRECT,
    DIFFUSE_INDIRECT,
    SPECULAR_DIRECT,
    SPECULAR_INDIRECT,
    shade_surfels,
    towards,
)

from .probe_scene import ProbeScene


class PlanRadiance:
    """Outgoing radiance of a scene's surfels towards its views, under any plan.

    ``albedo``, ``roughness_logit`` and ``environment`` are leaves of the graph, so that gradients can be compared. Each
    set of directions is shaded once, for white surfaces; a plan combines the parts and multiplies them by the albedo,
    which also depends on the plan (see ``lambert_albedo``).
    """

    def __init__(self, scene: ProbeScene) -> None:
        self.scene = scene
        surfels = scene.surfels
        self.albedo = surfels.albedo.clone().requires_grad_()
        self.roughness_logit = surfels.roughness_logit.clone().requires_grad_()
        self.environment = scene.environment.clone().requires_grad_()
        self.outgoing = torch.stack([towards(view.camera, surfels) for view in scene.views], 1)
        self._known: dict[tuple[bool, bool], tuple[Tensor, Tensor]] = {}

    @cached_property
    def projections(self) -> list[Projection]:
        """The surfels projected into each view."""
        surfels = self.scene.surfels
        return [surfels.seen_by(view.camera, radiance=False) for view in self.scene.views]

    @property
    def leaves(self) -> dict[str, Tensor]:
        """The tensors whose gradients are compared, by name."""
        return {"albedo": self.albedo, "roughness": self.roughness_logit, "light": self.environment}

    def shaded(self, plan: EffectPlan, sharp: bool = False) -> Float[Tensor, "surfels views 3"]:
        """L_PBR under a plan, linear RGB; ``sharp``: with the roughness ``ProbeScene.sharpest`` on every surface.

        Raises UsageError for a plan or a roughness that the scene was not traced for.
        """
        traced = plan.traced if plan.traces else False
        shiny = plan.specular_at if plan.specular else False
        parts, free = self._parts(plan.samples, sharp)
        by_bounces = parts if plan.bounces else self._first
        occluded, lit = (traced if on else False for on in (plan.visibility, plan.indirect))
        diffuse, specular = (
            _where(occluded, parts[:, :, direct], free[:, :, direct])
            + _where(lit, by_bounces[:, :, indirect], free[:, :, indirect])
            for direct, indirect in ((DIFFUSE_DIRECT, DIFFUSE_INDIRECT), (SPECULAR_DIRECT, SPECULAR_INDIRECT))
        )
        albedo = lambert_albedo(self.albedo, self._materials(sharp).roughness, plan.specular_among(self.albedo))
        return albedo[:, None] * diffuse + _where(shiny, specular, 0.0)

    def own(self, degree: int) -> Float[Tensor, "surfels views 3"]:
        """L_G, the surfels' own radiance, linear RGB, with harmonics up to ``degree``."""
        return surfel_radiance(self.scene.surfels.sh[:, : (degree + 1) ** 2], self.outgoing)

    def _parts(self, samples: int, sharp: bool) -> tuple[Tensor, Tensor]:
        """The four parts of white surfaces, shaded from traced light, and from its untraced substitute."""
        halved = samples > 1 and not sharp
        if (halved, sharp) not in self._known:
            both = self.scene.incident, self.scene.untraced
            if halved:
                half = both[0].weight.shape[1] // 2
                both = both[0].thinned(half), both[1].thinned(half)
            self._known[halved, sharp] = self._lit(both[0], sharp), self._lit(both[1], sharp)
        return self._known[halved, sharp]

    @cached_property
    def _first(self) -> Tensor:
        incident, first = self.scene.incident, self.scene.first
        if first is None:
            raise UsageError(
                "a plan without bounces for a scene that was traced without them",
                "The light scattered by one surface alone was not traced.",
                "Trace the scene with bounces=True.",
            )
        return self._lit(replace(incident, radiance=first))

    def _lit(self, incident: Incident, sharp: bool = False) -> Float[Tensor, "surfels views 4 3"]:
        white = torch.ones_like(self.albedo)
        return shade_surfels(self._materials(sharp), white, incident, self.outgoing, self.environment)

    def _materials(self, sharp: bool) -> Surfels:
        logit = self.roughness_logit
        if sharp:
            if self.scene.sharpest is None:
                raise UsageError(
                    "another roughness for a scene whose materials are final",
                    "The scene has no roughness that training may still reach.",
                    "Set ProbeScene.sharpest.",
                )
            logit = torch.full_like(logit, roughness_to_logit(self.scene.sharpest))
        return Surfels.of(self.scene.surfels.parameters() | {"roughness_logit": logit})


def _where(chosen: Bool[Tensor, " surfels"] | bool | None, one: Tensor, other: Tensor | float) -> Tensor:
    """``one`` for the chosen surfels, ``other`` for the rest. ``chosen``: None: all; False: none."""
    if chosen is None:
        return one
    if isinstance(chosen, bool):
        return other if isinstance(other, Tensor) else torch.zeros_like(one)
    return torch.where(chosen[:, None, None], one, other)
