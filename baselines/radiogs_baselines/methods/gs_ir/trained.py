"""A trained GS-IR model as the harness shows it: under the light that it has recovered, and relit."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

from ..split_sum import Frame, SplitSumLight
from ..trained_on_surfels import Shown, TrainedOnSurfels
from .labels import labels_of
from .model import Model
from .prefilter import filtered_light
from .rendering import View


class TrainedGSIR(TrainedOnSurfels[Model]):
    """Surfels with materials, a light and two volumes, and what they were trained on; see ``contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))

    def facts(self) -> dict[str, Any]:
        """``probes``: how many. The rest: see ``TrainedOnSurfels``."""
        occlusion = self.model.occlusion
        return super().facts() | {"probes": 0 if occlusion is None else len(occlusion.coefficients)}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply`` and, as far as there are any, ``metallic.npy`` [surfels] and ``volumes.npz``.

        Volumes: ``occlusion`` and ``irradiance``, harmonics [corners, corners, corners, coefficients] along x, y and z
        in 3DGS's basis, over the cube from ``low`` with edge ``edge``, world units. Raises OSError.
        """
        written = super().export(folder)
        if self.model.metallic is not None:
            written.append(folder / "metallic.npy")
            np.save(written[-1], self.model.metallic.detach().cpu().numpy())
        if self.model.occlusion is not None:
            written.append(folder / "volumes.npz")
            np.savez(written[-1], allow_pickle=False, **self._volumes())
        return written

    def _volumes(self) -> dict[str, np.ndarray]:
        occlusion, irradiance = self.model.occlusion, self.model.irradiance
        assert occlusion is not None
        lattice = occlusion.lattice
        found = {"occlusion": occlusion.coefficients[occlusion.probe].view(*(lattice.corners,) * 3, -1)}
        if irradiance is not None:
            found["irradiance"] = irradiance.coefficients.detach().view(*(irradiance.lattice.corners,) * 3, -1)
        found |= {"low": lattice.low, "edge": torch.tensor(lattice.edge)}
        return {name: value.cpu().numpy() for name, value in found.items()}

    def as_trained(self) -> Prepared:
        """With both volumes."""
        light = self._filtered(self.model.environment.detach(), "oriented")
        return Shown(_AsTrained(self.model, light, self.run))

    def relit(self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"]) -> Prepared:
        """Without occlusion or indirect light."""
        albedo = self.model.surfels.albedo.detach() * albedo_scale
        new = self._filtered(light.radiance, self.run.variant.frame)
        return Shown(_Relit(self.model, albedo, new, self.run.variant.straight))

    def _filtered(self, radiance: Tensor, frame: Frame) -> SplitSumLight:
        return SplitSumLight(filtered_light(radiance, self.run.variant.texel_areas), frame).ready()


class _AsTrained:
    def __init__(self, model: Model, light: SplitSumLight, run: Run) -> None:
        self.model, self.light, self.run = model, light, run

    @torch.no_grad()
    def render(self, camera: Camera) -> Maps:
        view = View.of(camera, self.model, self.model.surfels.albedo)
        shaded = view.shaded(self.model, self.light, self.run.budget.occlusion_samples)
        return view.maps(shaded, self.run.variant.straight)


class _Relit:
    """``albedo`` is given apart, because relighting scales it."""

    def __init__(self, model: Model, albedo: Float[Tensor, "surfels 3"], light: SplitSumLight, straight: bool) -> None:
        self.model, self.albedo, self.light, self.straight = model, albedo, light, straight

    @torch.no_grad()
    def render(self, camera: Camera) -> Maps:
        view = View.of(camera, self.model, self.albedo)
        return view.maps(view.relit(self.light), self.straight)
