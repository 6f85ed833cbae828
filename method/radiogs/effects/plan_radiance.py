"""Radiance of surfels under different plans, from the same directions, so that differences carry no sampling noise."""

from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.kernels.rasterize.rasterize import Projection, project
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
    """Radiance that the surfels of a scene send towards its views, under any plan.

    ``albedo``, ``roughness_logit`` and ``environment`` are leaves, so that gradients can be compared too. Each set of
    directions is shaded once, with white surfaces; a plan combines the parts and multiplies by the albedo, which
    depends on the plan too (see ``lambert_albedo``).
    """

    def __init__(self, scene: ProbeScene) -> None:
        self.scene = scene
        surfels = scene.surfels
        self.albedo = surfels.albedo.clone().requires_grad_()
        self.roughness_logit = surfels.roughness_logit.clone().requires_grad_()
        self.environment = scene.environment.clone().requires_grad_()
        self.outgoing = torch.stack([towards(view.camera, surfels) for view in scene.views], 1)

    @cached_property
    def projections(self) -> list[Projection]:
        """The surfels projected into each view."""
        surfels = self.scene.surfels
        return [project(view.camera, surfels.geometry_for(view.camera)) for view in self.scene.views]

    @property
    def leaves(self) -> dict[str, Tensor]:
        """The quantities whose gradients are compared."""
        return {"albedo": self.albedo, "roughness": self.roughness_logit, "light": self.environment}

    def shaded(self, plan: EffectPlan, sharp: bool = False) -> Float[Tensor, "surfels views 3"]:
        """L_PBR under a plan; ``sharp``: as if every surface had the roughness ``ProbeScene.sharpest``."""
        traced = plan.traced if plan.traces else False
        shiny = plan.specular_at if plan.specular else False
        parts, free = self._parts(plan.samples, sharp)
        met = parts if plan.bounces else self._first
        seen, lit = (traced if on else False for on in (plan.visibility, plan.indirect))
        diffuse, specular = (
            _where(seen, parts[:, :, direct], free[:, :, direct])
            + _where(lit, met[:, :, indirect], free[:, :, indirect])
            for direct, indirect in ((DIFFUSE_DIRECT, DIFFUSE_INDIRECT), (SPECULAR_DIRECT, SPECULAR_INDIRECT))
        )
        scattered = lambert_albedo(self.albedo, self._materials(sharp).roughness, plan.specular_among(self.albedo))
        return scattered[:, None] * diffuse + _where(shiny, specular, 0.0)

    def own(self, degree: int) -> Float[Tensor, "surfels views 3"]:
        """L_G, the surfels' own radiance, with harmonics up to ``degree``."""
        return surfel_radiance(self.scene.surfels.sh[:, : (degree + 1) ** 2], self.outgoing)

    def _parts(self, samples: int, sharp: bool) -> tuple[Tensor, Tensor]:
        """The four parts shaded from traced light, and from what stands for it."""
        if sharp:
            return self._sharp
        return self._whole if samples == 1 else self._half

    @cached_property
    def _whole(self) -> tuple[Tensor, Tensor]:
        return self._both(self.scene.incident, self.scene.untraced)

    @cached_property
    def _half(self) -> tuple[Tensor, Tensor]:
        incident, untraced = self.scene.incident, self.scene.untraced
        half = incident.weight.shape[1] // 2
        return self._both(incident.thinned(half), untraced.thinned(half))

    @cached_property
    def _sharp(self) -> tuple[Tensor, Tensor]:
        return self._both(self.scene.incident, self.scene.untraced, sharp=True)

    @cached_property
    def _first(self) -> Tensor:
        incident, first = self.scene.incident, self.scene.first
        if first is None:
            raise UsageError("bounces of a scene that was traced without them")
        once = Incident(incident.direction, incident.weight, incident.visibility, first)
        return self._lit(once)

    def _both(self, incident: Incident, untraced: Incident, sharp: bool = False) -> tuple[Tensor, Tensor]:
        return self._lit(incident, sharp), self._lit(untraced, sharp)

    def _lit(self, incident: Incident, sharp: bool = False) -> Float[Tensor, "surfels views 4 3"]:
        white = torch.ones_like(self.albedo)
        return shade_surfels(self._materials(sharp), white, incident, self.outgoing, self.environment)

    def _materials(self, sharp: bool) -> Surfels:
        logit = self.roughness_logit
        if sharp:
            if self.scene.sharpest is None:
                raise UsageError("another roughness of a scene whose materials are final")
            logit = torch.full_like(logit, roughness_to_logit(self.scene.sharpest))
        return Surfels.of(self.scene.surfels.parameters() | {"roughness_logit": logit})


def _where(chosen: Bool[Tensor, " surfels"] | bool | None, one: Tensor, other: Tensor | float) -> Tensor:
    """``one`` for the chosen surfels, ``other`` for the rest. None: all are chosen; False: none is."""
    if chosen is None:
        return one
    if isinstance(chosen, bool):
        return other if isinstance(other, Tensor) else torch.zeros_like(one)
    return torch.where(chosen[:, None, None], one, other)
