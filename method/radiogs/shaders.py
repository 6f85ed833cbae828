"""Shaders of L_PBR, the physical radiance that stage 2 compares with the images and with the surfels' own radiance.

``MonteCarlo`` is the paper's: Eq. 8 over traced rays, with the incident light cached between two tracings
(``IncidentCache``). ``SplitSum`` is prefiltered light without occlusion and without indirect light.
"""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splatting import shade_surfels, towards
from radiogs_core.transport.splitsum import Masking, PrefilteredLight, split_sum_radiance

from .consistency import RadiometricConsistency, split_sum_consistency_loss
from .incident_cache import IncidentCache
from .model import Model


@runtime_checkable
class Shader(Protocol):
    """Computes L_rad and L_PBR while materials and light are learnt."""

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad, without its weight, for the step ``iteration`` on a view of ``camera``."""

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels 3"]:
        """L_PBR of every surfel along the unit directions ``outgoing``, linear RGB. ``light``: prefiltered."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state that ``state`` returned."""


class MonteCarlo:
    """Eq. 8 over traced rays: L_rad from new rays of N_g random surfels, L_PBR from the cached light of all surfels."""

    def __init__(self, radiometric: RadiometricConsistency, cache: IncidentCache) -> None:
        self.radiometric, self.cache = radiometric, cache

    def consistency(self, model: Model, camera: Camera, iteration: int) -> Float[Tensor, ""]:
        """L_rad over N_g random surfels, from rays traced now."""
        index = self.drawn(model.surfels)
        incident = self.cache.light_on(index, model.surfels, iteration)
        return self.radiometric.loss(model.surfels, model.environment, camera, index, incident, self.cache.generator)

    def drawn(self, surfels: Surfels) -> Int[Tensor, " chosen"]:
        """Indices of N_g surfels, drawn without repetition; of all surfels if there are fewer."""
        generator = self.cache.generator
        order = torch.randperm(len(surfels), generator=generator, device=generator.device)
        return order[: self.cache.budget.consistency_surfels]

    def radiance(
        self, model: Model, outgoing: Float[Tensor, "surfels 3"], light: PrefilteredLight
    ) -> Float[Tensor, "surfels 3"]:
        """L_PBR of every surfel, as a Monte-Carlo sum over its cached light, linear RGB."""
        surfels, incident = model.surfels, self.cache.incident
        return shade_surfels(surfels, surfels.albedo, incident, outgoing[:, None], model.environment)[:, 0].sum(1)

    def state(self) -> dict[str, Any]:
        """The cached light."""
        return {"incident": vars(self.cache.incident)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.cache.incident = Incident(**state["incident"])


class SplitSum:
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
    ) -> Float[Tensor, "surfels 3"]:
        """L_PBR of every surfel, as the sum of diffuse and specular split-sum radiance, linear RGB."""
        surfels = model.surfels
        diffuse, specular = split_sum_radiance(
            surfels.frame[..., 2], surfels.albedo, surfels.roughness, outgoing, light
        )
        return diffuse + specular

    def state(self) -> dict[str, Any]:
        """An empty state."""
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Does nothing."""
