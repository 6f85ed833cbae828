"""Rendering of a trained GS-IR model, under the recovered light and relit; labels of a run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Maps, Prepared, Run
from radiogs_core.on_surfels.split_sum_light import Frame, SplitSumLight
from radiogs_core.on_surfels.trained import Shown, TrainedOnSurfels, light_start, reduced
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.maps import blended_maps

from .model import Model
from .prefilter import filtered_light
from .settings import PRESETS, Budget, Variant
from .shading import Shaded, View


class TrainedGSIR(TrainedOnSurfels[Model, Variant, Budget]):
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run[Variant, Budget]) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))

    def facts(self) -> dict[str, Any]:
        """Adds ``probes``, the number of occlusion probes, to the facts of ``TrainedOnSurfels``."""
        occlusion = self.model.occlusion
        return super().facts() | {"probes": 0 if occlusion is None else len(occlusion.coefficients)}

    def export(self, folder: Path) -> list[Path]:
        """Write ``surfels.ply`` and, if the model has them, ``metallic.npy`` [surfels] and ``volumes.npz``.

        Arrays of ``volumes.npz``: ``occlusion`` and ``irradiance``, harmonics [corners, corners, corners, coefficients]
        along x, y and z in 3DGS's basis, over the cube from ``low`` with edge ``edge``, world units. Raises OSError.
        """
        written = super().export(folder)
        if self.model.metallic is not None:
            written.append(folder / "metallic.npy")
            np.save(written[-1], self.model.metallic.detach().cpu().numpy())
        occlusion, irradiance = self.model.occlusion, self.model.irradiance
        if occlusion is not None:
            lattice = occlusion.lattice
            volumes = {"occlusion": occlusion.coefficients[occlusion.probe].view(*(lattice.corners,) * 3, -1)}
            if irradiance is not None:
                volumes["irradiance"] = irradiance.coefficients.detach().view(*(irradiance.lattice.corners,) * 3, -1)
            volumes |= {"low": lattice.low, "edge": torch.tensor(lattice.edge)}
            written.append(folder / "volumes.npz")
            arrays = {name: value.cpu().numpy() for name, value in volumes.items()}
            np.savez(written[-1], allow_pickle=False, **arrays)
        return written

    def as_trained(self) -> Prepared:
        """Rendering under the recovered light, with both volumes."""
        model, samples = self.model, self.run.budget.occlusion_samples
        light = self._filtered(model.environment.detach(), "oriented")
        return Shown(Renderer(model, model.surfels.albedo, lambda view: view.shaded(model, light, samples), self.run))

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """Rendering under ``light``, without occlusion and indirect light."""
        albedo = self.model.surfels.albedo.detach() * albedo_scale
        new = self._filtered(light.radiance, self.run.variant.frame)
        return Shown(Renderer(self.model, albedo, lambda view: view.relit(new), self.run))

    def _filtered(self, radiance: Tensor, frame: Frame) -> SplitSumLight:
        return SplitSumLight(
            filtered_light(radiance, self.run.variant.texel_areas, self.run.variant.masking), frame
        ).ready()


class Renderer:
    """Renders a model whose points ``shade`` lights. ``albedo`` (linear) is scaled by relighting."""

    def __init__(
        self, model: Model, albedo: Float[Tensor, "surfels 3"], shade: Callable[[View], Shaded], run: Run
    ) -> None:
        self.model, self.albedo, self.shade, self.straight = model, albedo, shade, run.variant.straight

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps of one view; see ``on_surfels.trained.Renderer``."""
        view = View.of(camera, self.model, self.albedo)
        shaded = self.shade(view)
        return {
            "image": view.image(shaded, self.straight).clamp(0, 1),
            "direct": view.map_of(shaded.direct),
            "indirect": view.map_of(shaded.indirect),
            **blended_maps(view.seen),
        }


PAPER = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Differences from the published method, by name. ``extent``: the scene's extent, world units."""
    labels = {
        "geometry": "surfels of this project and their normals in place of 3D Gaussians with a normal of their own",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": light_start(variant.materials.start.light, "random between 0.25 and 0.75"),
        "light": "a lat-long map of log-radiance (published: a cube map of radiance, not below zero)",
        "texel_areas": f"{variant.texel_areas} in the diffuse pre-filter (published: approximate, 8 % brighter)",
        "relight_frame": "Y-up lookup of new lights along Z-up directions, as published"
        if variant.frame == "as_shipped"
        else "new lights as their maps are meant (published: a Y-up lookup along Z-up directions)",
        "roughness": "from 0.05, in training and shown (published: from 0.04 in training, from 0 shown)",
        "encoding": "images are encoded for display (published: an option, --gamma)",
    }
    if variant.occlusion:
        labels |= {
            "tau": "none: occluders at any distance (published: 0.25)"
            if variant.tau is None
            else f"{variant.tau * extent:.3g} world units (published: 0.25)",
            "nearest": _nearest(variant, extent),
            "probes": "where a surfel is within one standard deviation (published: in the cells of Gaussians' centres)",
            "box": "the cube around the surfels (published: [-1.5, 1.5]^3)",
            "occlusion_rays": f"{budget.occlusion_directions} traced directions (published: six faces of 256 x 256)",
        }
    lower = reduced(budget, PAPER, "inverse_iterations", "occlusion_corners", "occlusion_samples", "irradiance_corners")
    if variant.lr_scale != 1:
        lower["lr_scale"] = f"{variant.lr_scale:g} of the rates that stage 1 ends with (published: 1)"
    return labels | lower


def _nearest(variant: Variant, extent: float) -> str:
    published = "(published: Gaussians nearer than 0.2 along a face's axis are not drawn)"
    if variant.nearest == 0:
        return f"occluders at any distance below tau {published}"
    return f"occluders from {variant.nearest * extent:.3g} world units on {published}"
