"""Shaders of L_PBR, the physical radiance that stage 2 compares with the images and with the surfels' own radiance.

``MonteCarlo`` is the paper's: Eq. 8 over traced rays, with the incident light cached between two tracings
(``IncidentCache``). ``SplitSum`` is prefiltered light without occlusion and without indirect light.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.kernels.shade.shade import arrive, shade_total
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.prefiltered_light import Masking, PrefilteredLight, split_sum_radiance
from radiogs_core.transport.shading import lambert_albedo
from radiogs_core.transport.splatting import towards

from .consistency import RadiometricConsistency, split_sum_consistency_loss
from .incident_cache import IncidentCache
from .kept_light import KeptLight
from .model import Model


class Shader(ABC):
    """Computes L_rad and L_PBR while materials and light are learnt."""

    @abstractmethod
    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad, without its weight, for the step ``iteration`` on a view of ``camera``."""

    @abstractmethod
    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels sets 3"]:
        """L_PBR of every surfel along the unit directions ``outgoing``, linear RGB, by each independent set of
        incident directions. ``light``: prefiltered."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit; none by default."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state that ``state`` returned."""
        assert not state


@dataclass(frozen=True)
class Arriving:
    """V Env + L_ind of all cached samples under a fixed light, and the inputs that it was computed from."""

    radiance: Float[Tensor, "surfels samples 3"]
    """The incident radiance, linear RGB."""
    indirect: Float[Tensor, "surfels samples 3"]
    """The cached L_ind, which holds other samples after each tracing of all surfels."""
    traced_at: int
    """The step at which all surfels were last traced."""
    log_environment: Float[Tensor, "height width 3"]
    """The light."""
    version: int
    """How often the light had been changed in place."""

    def stands(self, cache: IncidentCache, light: Float[Tensor, "height width 3"]) -> bool:
        """Whether the inputs are still the given cache's and light's."""
        traced = self.indirect is cache.incident.radiance and self.traced_at == cache.traced_at
        return traced and self.log_environment is light and self.version == light._version


class MonteCarlo(Shader):
    """Eq. 8 over traced rays: L_rad from new rays of N_g random surfels, L_PBR from the cached light of all surfels."""

    def __init__(self, radiometric: RadiometricConsistency, cache: IncidentCache) -> None:
        self.radiometric, self.cache = radiometric, cache
        self.arriving: Arriving | None = None

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad over N_g random surfels, from rays traced now."""
        index, environment = self.drawn(model.surfels), model.environment
        specular_at = self.cache.plan.specular_among(model.surfels.albedo_logit)
        incident = self.cache.light_on(index, model, iteration)
        if self.arriving is not None and self.arriving.stands(self.cache, model.log_environment):
            rows = self.cache.rows(index, self.cache.set_of(iteration))
            by_set = self.arriving.radiance.view(-1, *incident.radiance.shape[1:])
            arrive(by_set, rows, incident.direction, incident.visibility, incident.radiance, environment)
        generator = self.cache.generator
        return self.radiometric.loss(model.surfels, environment, camera, index, incident, generator, specular_at)

    def drawn(self, surfels: Surfels) -> Int[Tensor, " chosen"]:
        """Indices of N_g surfels, drawn without repetition; of all surfels if there are fewer."""
        generator = self.cache.generator
        order = torch.randperm(len(surfels), generator=generator, device=generator.device)
        return order[: self.cache.budget.consistency_surfels]

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels sets 3"]:
        """L_PBR of every surfel, as Monte-Carlo sums over its cached light, linear RGB."""
        incident, environment = self.cache.incident, model.environment
        if model.log_environment.requires_grad:
            return self.sums(model, outgoing, incident.visibility, incident.radiance, environment)
        return self.sums(model, outgoing, None, self.arrived(model), None)

    def sums(
        self,
        model: Model,
        outgoing: Float[Tensor, "surfels 3"],
        visibility: Float[Tensor, "surfels samples"] | None,
        radiance: Float[Tensor, "surfels samples 3"],
        environment: Float[Tensor, "height width 3"] | None,
    ) -> Float[Tensor, "surfels sets 3"]:
        """The sums over each set of cached directions; see ``shade_total`` for the arguments."""
        surfels, incident, sets = model.surfels, self.cache.incident, self.cache.sets
        specular_at = self.cache.plan.specular_among(surfels.albedo_logit)
        albedo = lambert_albedo(surfels.albedo, surfels.roughness, specular_at)
        count, samples = incident.weight.shape

        def by_set(value: Tensor) -> Tensor:
            """The samples of each set, as if each set belonged to a surfel of its own."""
            return value.view(sets * count, samples // sets, *value.shape[2:])

        sums = shade_total(
            surfels.frame, albedo, surfels.roughness, outgoing[:, None],
            by_set(incident.direction), by_set(incident.weight),
            None if visibility is None else by_set(visibility), by_set(radiance), environment,
            specular_at,
        )  # fmt: skip
        return sums.view(count, sets, 3) if sets == 1 else sets * sums.view(count, sets, 3)

    def arrived(self, model: Model) -> Float[Tensor, "surfels samples 3"]:
        """V Env + L_ind of all cached samples under a fixed light; kept between steps until new rays are traced."""
        incident, light = self.cache.incident, model.log_environment
        if self.arriving is None or not self.arriving.stands(self.cache, light):
            made, every = torch.empty_like(incident.radiance), torch.arange(len(incident.weight), device=light.device)
            arrive(made, every, incident.direction, incident.visibility, incident.radiance, model.environment)
            self.arriving = Arriving(made, incident.radiance, self.cache.traced_at, light, light._version)
        return self.arriving.radiance

    def state(self) -> dict[str, Any]:
        """The cached light, and the light that surfels without rays keep."""
        kept = self.cache.kept
        return {"incident": vars(self.cache.incident)} | ({} if kept is None else {"kept": vars(kept)})

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.cache.incident, self.arriving = Incident(**state["incident"]), None
        self.cache.kept = KeptLight(**state["kept"]) if "kept" in state else None


class SplitSum(Shader):
    """Split-sum shading by prefiltered light. It traces no rays and has no state."""

    def __init__(self, masking: Masking) -> None:
        self.masking: Masking = masking

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad over all surfels, towards the camera."""
        outgoing, light = towards(camera, model.surfels), PrefilteredLight(model.environment, self.masking)
        own = surfel_radiance(model.surfels.sh, outgoing)
        return split_sum_consistency_loss(model.surfels, own, light, outgoing)[0]

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels 1 3"]:
        """L_PBR of every surfel, as the sum of diffuse and specular split-sum radiance, linear RGB."""
        surfels = model.surfels
        diffuse, specular = split_sum_radiance(
            surfels.frame[..., 2], surfels.albedo, surfels.roughness, outgoing, light
        )
        return (diffuse + specular)[:, None]
