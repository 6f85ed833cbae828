"""Stage 1, initialisation: 2DGS reconstruction with split-sum shading and simplified radiometric consistency."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Run
from radiogs_core.on_surfels.fit_geometry import FitGeometry, Shading
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from radiogs_core.transport.splatting import towards

from .consistency import split_sum_consistency_loss
from .model import Model, constant_light
from .settings import Budget, Variant


class Initialisation(FitGeometry):
    """Stage 1. With ``variant.initialise == "nvs"`` it is novel-view synthesis alone, without shading."""

    name = "initialise"

    def __init__(self, run: Run[Variant, Budget]) -> None:
        variant, budget = run.variant, run.budget
        shading_of = SplitSumShading if variant.initialise == "radiometric" else UnseenMaterials
        shading = shading_of(variant, budget.light_height, run.device)
        super().__init__(run, variant.surfel_learning, budget.geometry, variant.view_share, shading)

    @property
    def model(self) -> Model:
        """The present surfels and light."""
        return Model(self.surfels, self.optimiser.tensors["log_environment"])


class UnseenMaterials(Shading):
    """Stage 1 without shaded images: materials and light keep their initial values until stage 2 learns them."""

    def __init__(self, variant: Variant, light_height: int, device: torch.device) -> None:
        self.learning = learning = variant.split_sum
        self.masking = variant.masking
        self.image_weight, self.geometry_gradient = learning.image, learning.geometry_gradient
        self.tensors = {"log_environment": constant_light(light_height, learning.light, device)}
        self.rates = {
            "albedo_logit": learning.albedo_rate,
            "roughness_logit": learning.roughness_rate,
            "log_environment": learning.light_rate,
        }


class SplitSumShading(UnseenMaterials):
    """Split-sum shading of the surfels, and the simplified radiometric consistency of their radiance with it."""

    def images(
        self, surfels: Surfels, own: Tensor, tensors: Mapping[str, Tensor], camera: Camera, progress: float
    ) -> tuple[Mapping[str, Float[Tensor, "surfels 3"]], Mapping[str, Tensor]]:
        """L_PBR towards the camera, and, from ``consistency_from`` on, the weighted L_rad; see ``Shading.images``."""
        light = PrefilteredLight(tensors["log_environment"].exp(), self.masking)
        outgoing = towards(camera, surfels)
        consistency, shaded = split_sum_consistency_loss(surfels, own, light, outgoing, self.geometry_gradient)
        counts = progress >= self.learning.consistency_from
        return {"shaded": shaded}, {"consistency": self.learning.consistency * consistency} if counts else {}
