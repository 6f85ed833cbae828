"""Rendering of a trained TensoIR model, under the recovered light and relit.

A ray is marched for every pixel, and shaded where its coverage is above ``shading.SOLID``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import STANDARD_MAPS, Maps, Prepared, Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap

from .drawing import camera_rays
from .field import UNITS, Field
from .lighting import NewLight, RecoveredLight
from .losses import on_background
from .marching import Marched, Rays, march
from .model import Model
from .secondary import NEAR, NEAREST_SPACINGS
from .settings import PRESETS, Budget, Variant
from .shading import Materials, sample_values, surface_points, unit

RAYS_AT_ONCE = 2048
"""Camera rays marched and shaded in one batch."""

PixelMaps = dict[str, Float[Tensor, "pixels _"]]


class TrainedTensoIR:
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: Model, run: Run) -> None:
        self.model, self.run = model, run

    @property
    def light(self) -> EnvironmentMap:
        """The recovered light, on the CPU."""
        return EnvironmentMap(self.model.light.environment().radiance.cpu())

    def facts(self) -> dict[str, Any]:
        """``parameters``: number of learnt values. ``grid``: nodes of the grid along an edge.

        ``labels``: differences from the published method, by name (``labels_of``). ``remarks``: these as sentences.
        """
        labels = labels_of(self.run.variant, self.run.budget)
        field = self.model.field
        count = sum(value.numel() for value in field.parameters.values()) + self.model.light.raw.numel()
        remarks = [f"{name}: {value}" for name, value in labels.items()]
        return {"parameters": count, "grid": field.size, "labels": labels, "remarks": remarks}

    def export(self, folder: Path) -> list[Path]:
        """Write ``field.npz``: parameters by name, and the box's centre, radius and cells. Raises OSError."""
        path, box = folder / "field.npz", self.model.field.box
        arrays: dict[str, Any] = {name: value.cpu().numpy() for name, value in self.model.field.parameters.items()}
        arrays |= {"box_centre": box.centre.cpu().numpy(), "box_radius": np.float64(box.radius)}
        arrays["box_occupied"] = box.occupied.cpu().numpy()
        np.savez_compressed(path, allow_pickle=False, **arrays)
        return [path]

    def prepare(
        self,
        light: EnvironmentMap | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        after_step: Callable[[], None] = lambda: None,
    ) -> Prepared:
        """Rendering under the recovered light, or under ``light`` with direct light only; rays are marched per image.

        Raises DataError for a light that is not finite.
        """
        variant, budget, field = self.run.variant, self.run.budget, self.model.field
        device = field.box.centre.device
        if light is None:
            samples = (budget.light_rows, budget.secondary_samples)
            own = RecoveredLight(self.model.light, variant, *samples, displaced=False)
            scale, shaded = torch.ones(3, device=device), variant.shown == "shaded"
            return Renderer(field, variant, own, self.run.seed, shaded, scale)
        scale = torch.ones(3, device=device) if albedo_scale is None else albedo_scale.to(device)
        new = NewLight(
            EnvironmentMap(light.radiance.to(device)),
            budget.relight_samples,
            budget.secondary_samples,
            variant.relight_visibility,
        )
        return Renderer(field, variant, new, self.run.seed, True, scale)


@dataclass(frozen=True)
class Renderer:
    """Renders a field under a light (``contract.Prepared``). A camera's image does not depend on earlier images."""

    field: Field
    variant: Variant
    """The run's variant."""
    light: RecoveredLight | NewLight
    seed: int
    """Seed of the random directions of each image."""
    shaded: bool
    """Whether the image is shaded; otherwise it is the marched radiance field."""
    albedo_scale: Float[Tensor, "3"]
    """Factor on the recovered albedo, linear RGB."""

    timed = True
    default = frozenset(STANDARD_MAPS)
    offers = STANDARD_MAPS

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps of one view, [height, width, channels], all composited on black.

        image: display sRGB, clipped to [0, 1]. direct, indirect: linear outgoing radiance of solid pixels, zero
        elsewhere. albedo: linear. roughness, alpha, depth (world z-depth): one channel. normal: unit in the world,
        zero where empty.
        """
        camera = camera.to(self.field.box.centre.device, self.field.box.centre.dtype)
        rays = camera_rays(camera, self.field.box)
        generator = torch.Generator(rays.origin.device).manual_seed(self.seed)
        along = camera.ray_directions().flatten(0, 1).norm(dim=-1, keepdim=True)
        parts = []
        for some in torch.arange(len(rays), device=rays.origin.device).split(RAYS_AT_ONCE):
            maps = self._maps(Rays(rays.origin[some], rays.direction[some]), generator)
            parts.append(maps | {"depth": maps["depth"] * self.field.box.radius / along[some]})
        shape = (camera.height, camera.width, -1)
        return {name: torch.cat([part[name] for part in parts]).view(shape) for name in parts[0]}

    def _maps(self, rays: Rays, generator: torch.Generator) -> PixelMaps:
        marched = march(self.field, rays)
        values = sample_values(self.field, rays, marched)
        blended = values.materials(self.variant.normals)
        materials = Materials(blended.albedo * self.albedo_scale, blended.roughness, blended.normal)
        points = surface_points(rays, marched, materials)
        shaded = self.light.on(self.field, points, generator)
        empty = torch.zeros_like(rays.origin)
        if self.shaded:
            colour = srgb_encode((shaded.direct + shaded.indirect).clamp(0, 1))
            image = empty.index_copy(0, points.ray, colour)
        else:
            image = on_black(marched.blended(values.radiance), marched)
        return {
            "image": image,
            "alpha": marched.alpha[:, None],
            "direct": empty.index_copy(0, points.ray, shaded.direct),
            "indirect": empty.index_copy(0, points.ray, shaded.indirect),
            "albedo": materials.albedo,
            "roughness": materials.roughness[:, None],
            "normal": unit(materials.normal),
            "depth": marched.distance[:, None],
        }


def on_black(blended: Float[Tensor, "rays 3"], marched: Marched) -> Float[Tensor, "rays 3"]:
    """Display-sRGB image on black in [0, 1]: the image composited on white, minus the visible white.

    Partly covered pixels then equal those of images with an alpha channel.
    """
    alpha = marched.alpha
    on_white = on_background(blended, alpha, torch.ones_like(alpha[:, None]), linear=True)
    image = (on_white - (1 - alpha)[:, None]).clamp(0, 1)
    return torch.where(alpha[:, None] > 0, image, 0.0)


PAPER = PRESETS["paper"]

LABELLED_FIELDS = (
    "field_iterations", "inverse_iterations", "rays", "grid_start", "grid_end", "density_components",
    "appearance_components", "features", "hidden", "lobes", "light_rows", "secondary_samples", "relight_samples",
)  # fmt: skip
"""Fields of ``Budget`` that the label ``reduced`` lists if they differ from the preset ``paper``."""


def labels_of(variant: Variant, budget: Budget) -> dict[str, str]:
    """Differences from the published method, by name."""
    labels = {
        "geometry": "a field of its own, no surfels",
        "box": "the cube around the cells inside all silhouettes (published: around the learnt density)",
        "nvs": "images under the recovered light are the radiance field's, not shaded (as TensoIR reports them)"
        if variant.shown == "field"
        else "images under the recovered light are shaded (TensoIR reports the radiance field's)",
        "background": "random greys in stage 2 (published: white)"
        if variant.background == "random-later"
        else "white, as published",
        "rays": f"of {budget.views} views a step (published: of all)",
    }
    reduced = {
        f"{name} {getattr(budget, name)} (published: {getattr(PAPER, name)})"
        for name in LABELLED_FIELDS
        if getattr(budget, name) != getattr(PAPER, name)
    }
    if reduced:
        labels["reduced"] = ", ".join(sorted(reduced))
    start = NEAREST_SPACINGS * 2 / (budget.grid_end - 1)
    if start > NEAR:
        labels["ray_start"] = f"{start * UNITS:.3g} of the box's 3, for its grid is coarse (published: 0.05)"
    if budget.network_rate != PAPER.network_rate:
        labels["network_rate"] = f"{budget.network_rate:g} times the published one"
    return labels
