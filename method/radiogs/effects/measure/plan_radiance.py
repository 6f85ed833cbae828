"""The radiance that surfels send under different plans, from one set of directions: differences carry no noise."""

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
    """Radiance of a subject's surfels towards its sights under any plan.

    ``albedo``, ``roughness`` and ``environment`` are leaves, so that gradients can be compared too. Shading is done
    once for each set of directions and kind of light, of white surfaces, and put together for a plan: what they scatter
    by Lambert's law depends on the plan too.
    """

    def __init__(self, subject: ProbeScene) -> None:
        self.subject = subject
        surfels = subject.surfels
        self.albedo = surfels.albedo.clone().requires_grad_()
        self.roughness_logit = surfels.roughness_logit.clone().requires_grad_()
        self.environment = subject.environment.clone().requires_grad_()
        self.outgoing = torch.stack([towards(sight.camera, surfels) for sight in subject.sights], 1)

    @cached_property
    def projections(self) -> list[Projection]:
        """The surfels as the sights see them."""
        surfels = self.subject.surfels
        return [project(sight.camera, surfels.geometry_for(sight.camera)) for sight in self.subject.sights]

    @property
    def leaves(self) -> dict[str, Tensor]:
        """What gradients are compared of."""
        return {"albedo": self.albedo, "roughness": self.roughness_logit, "light": self.environment}

    def radiance(self, plan: EffectPlan, sharp: bool = False) -> Float[Tensor, "surfels views 3"]:
        """L_PBR under a plan; ``sharp``: as if every surface had the roughness of the subject's ``sharpest``."""
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
        """L_G with harmonics up to ``degree``."""
        return surfel_radiance(self.subject.surfels.sh[:, : (degree + 1) ** 2], self.outgoing)

    def _parts(self, samples: int, sharp: bool) -> tuple[Tensor, Tensor]:
        """The four parts by rays, and by what stands for them."""
        if sharp:
            return self._sharp
        return self._whole if samples == 1 else self._half

    @cached_property
    def _whole(self) -> tuple[Tensor, Tensor]:
        return self._shaded(self.subject.incident, self.subject.untraced)

    @cached_property
    def _half(self) -> tuple[Tensor, Tensor]:
        incident, untraced = self.subject.incident, self.subject.untraced
        half = incident.weight.shape[1] // 2
        return self._shaded(incident.thinned(half), untraced.thinned(half))

    @cached_property
    def _sharp(self) -> tuple[Tensor, Tensor]:
        return self._shaded(self.subject.incident, self.subject.untraced, sharp=True)

    @cached_property
    def _first(self) -> Tensor:
        incident, first = self.subject.incident, self.subject.first
        if first is None:
            raise UsageError("bounces of a subject that was traced without them")
        once = Incident(incident.direction, incident.weight, incident.visibility, first)
        return self._lit(once)

    def _shaded(self, incident: Incident, untraced: Incident, sharp: bool = False) -> tuple[Tensor, Tensor]:
        return self._lit(incident, sharp), self._lit(untraced, sharp)

    def _lit(self, incident: Incident, sharp: bool = False) -> Float[Tensor, "surfels views 4 3"]:
        white = torch.ones_like(self.albedo)
        return shade_surfels(self._materials(sharp), white, incident, self.outgoing, self.environment)

    def _materials(self, sharp: bool) -> Surfels:
        logit = self.roughness_logit
        if sharp:
            if self.subject.sharpest is None:
                raise UsageError("another roughness of a subject whose materials are final")
            logit = torch.full_like(logit, roughness_to_logit(self.subject.sharpest))
        return Surfels.of(self.subject.surfels.parameters() | {"roughness_logit": logit})


def _where(chosen: Bool[Tensor, " surfels"] | bool | None, one: Tensor, other: Tensor | float) -> Tensor:
    """``one`` for the chosen surfels, ``other`` for the rest; None: all are chosen, False: none."""
    if chosen is None:
        return one
    if isinstance(chosen, bool):
        return other if isinstance(other, Tensor) else torch.zeros_like(one)
    return torch.where(chosen[:, None, None], one, other)
