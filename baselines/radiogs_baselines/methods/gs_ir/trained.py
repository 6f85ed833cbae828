"""A trained GS-IR model as the harness shows it: under the light that it has recovered, and relit."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import MapKind, Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.ply import write_ply
from radiogs_core.transport.sampling import require_finite_light

from .labels import labels_of
from .model import Model
from .prefilter import filtered_light
from .rendering import View
from .shading import SplitSumLight

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
"""Maps of every rendering, all composited on black; ``indirect`` is what the irradiance volume makes surfaces send."""


class TrainedGSIR:
    """Surfels with materials, a light and two volumes, and what they were trained on; see ``contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.environment.detach().cpu())

    def facts(self) -> dict[str, Any]:
        """``surfels`` and ``probes``: how many. ``labels``: what differs from the published method, by name.

        ``remarks``: the same in sentences.
        """
        labels = labels_of(self.run.variant, self.run.budget, self.run.scene.extent)
        occlusion = self.model.occlusion
        return {
            "surfels": len(self.model.surfels),
            "probes": 0 if occlusion is None else len(occlusion.coefficients),
            "labels": labels,
            "remarks": [f"{name}: {value}" for name, value in labels.items()],
        }

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply`` and, as far as there are any, ``metallic.npy`` [surfels] and ``volumes.npz``.

        Volumes: ``occlusion`` and ``irradiance``, harmonics [corners, corners, corners, coefficients] along x, y and z
        in 3DGS's basis, over the cube from ``low`` with edge ``edge``, world units. Raises OSError.
        """
        written = [folder / "surfels.ply"]
        write_ply(self.model.surfels, written[0])
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

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Shaded as it was trained, or relit, without occlusion or indirect light."""
        albedo = self.model.surfels.albedo.detach()
        if light is None:
            return _Shown(self, albedo, self._filtered(self.model.environment.detach()), relit=False)
        require_finite_light(light)
        if albedo_scale is not None:
            albedo = albedo * albedo_scale.to(albedo.device)
        return _Shown(self, albedo, self._filtered(light.radiance.to(albedo.device), relit=True), relit=True)

    def _filtered(self, radiance: Tensor, relit: bool = False) -> SplitSumLight:
        variant = self.run.variant
        filtered = filtered_light(radiance, variant.texel_areas)
        # The kernel's maps are made now: the first frame, which is timed, must not wait for them.
        _ = filtered.diffuse, filtered.glossy
        return SplitSumLight(filtered, variant.frame if relit else "oriented")


class _Shown:
    """Under one light; ``albedo`` is given apart, because relighting scales it."""

    timed = True
    default = frozenset(SHOWN)
    offers = SHOWN

    def __init__(
        self, trained: TrainedGSIR, albedo: Float[Tensor, "surfels 3"], light: SplitSumLight, relit: bool
    ) -> None:
        self.trained, self.albedo, self.light, self.relit = trained, albedo, light, relit

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """The maps of one view."""
        model, run = self.trained.model, self.trained.run
        view = View.of(camera, model, self.albedo)
        shaded = view.relit(self.light) if self.relit else view.shaded(model, self.light, run.budget.occlusion_samples)
        return view.maps(shaded, run.variant.straight)
