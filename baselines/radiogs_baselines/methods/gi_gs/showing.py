"""Rendering of a trained GI-GS model, frame by frame, under the recovered light and relit; labels of a run."""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import STANDARD_MAPS, MapKind, Maps, Prepared, Run
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.on_surfels.trained import INCIDENT, Shown, TrainedOnSurfels, light_start, reduced
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.maps import blended_maps
from radiogs_core.transport.prefiltered_light import PrefilteredLight

from ..gs_ir.metallic import MetallicSurfels
from .gbuffer import gbuffer, seen_materials
from .marching import Grid, March
from .settings import PRESETS, Budget, Variant
from .shading import Shader

SHOWN = {**STANDARD_MAPS, INCIDENT: MapKind("linear")}
"""Maps under the recovered light; incident light comes only from other pixels."""


class TrainedGIGS(TrainedOnSurfels[MetallicSurfels, Variant, Budget]):
    """A trained model and its run; see ``radiogs_core.contract.Trained``."""

    def __init__(self, model: MetallicSurfels, run: Run[Variant, Budget]) -> None:
        super().__init__(model, run, labels_of(run.variant, run.budget, run.scene.extent))

    def as_trained(self) -> Prepared:
        """Rendering under the recovered light, shaded as in training."""
        own = self._shader(self.run.variant.occlusion, self.run.variant.indirect)
        light = SplitSumLight(PrefilteredLight(self.model.environment.detach(), self.run.variant.masking)).ready()
        return Shown(Renderer(self.model, self.model.surfels.albedo.detach(), light, own), SHOWN)

    def relit(
        self, light: EnvironmentMap, albedo_scale: Float[Tensor, "3"], after_step: Callable[[], None]
    ) -> Prepared:
        """Rendering under ``light``, without occlusion and with the frame's bounce under that light."""
        new = SplitSumLight(PrefilteredLight(light.radiance, self.run.variant.masking), self.run.variant.frame).ready()
        shader = self._shader(occlusion=False, indirect=self.run.variant.relight_indirect)
        return Shown(Renderer(self.model, self.model.surfels.albedo.detach() * albedo_scale, new, shader))

    def _shader(self, occlusion: bool, indirect: bool) -> Shader:
        variant, budget = self.run.variant, self.run.budget
        grid = Grid.of(budget.render_azimuths, budget.render_heights)
        march = March.of(grid, variant, budget.march_steps, self.run.scene.extent, variant.start)
        return Shader(march, occlusion, indirect, variant.sum, variant.straight)


class Renderer:
    """Renders a model under one light. ``albedo`` (linear) may differ from the model's: relighting scales it."""

    def __init__(
        self, model: MetallicSurfels, albedo: Float[Tensor, "surfels 3"], light: SplitSumLight, shader: Shader
    ) -> None:
        self.model, self.albedo, self.light, self.shader = model, albedo, light, shader

    @torch.no_grad()
    def render(self, camera: Camera, *further: str) -> Maps:
        """Maps of one view (see ``on_surfels.trained.Renderer``); the lit ones are from ``Shader.shade``."""
        seen = seen_materials(camera, self.model, self.albedo)
        shaded = self.shader.shade(gbuffer(camera, seen), seen.alpha, self.light)
        return {**shaded, "image": shaded["image"].clamp(0, 1), **blended_maps(seen)}


PAPER = PRESETS["paper"]

PUBLISHED_LENGTHS = {"radius": 0.8, "bias": 0.01, "thick": 0.05, "far": 100.0}
"""Lengths of the published script, in the world units of TensoIR's scenes."""


def labels_of(variant: Variant, budget: Budget, extent: float) -> dict[str, str]:
    """Differences from the published method, by name. ``extent``: the scene's extent, world units."""
    lengths = (
        f"{name} {extent * getattr(variant, name):.3g} (published: {value:g})"
        for name, value in PUBLISHED_LENGTHS.items()
    )
    moves = (
        f"moved in stage 2 at {variant.lr_scale:g} times the rates that stage 1 ends with"
        if variant.lr_scale
        else "frozen in stage 2 (published: moved by the blending of the maps)"
    )
    labels = {
        "geometry": f"surfels of this project in place of 3D Gaussians with a normal of their own; {moves}",
        "stage1": "shared: novel-view synthesis of surfels in place of 3D Gaussians",
        "light_start": light_start(variant.materials.start.light, "random between 0.25 and 0.75"),
        "lengths": f"shares of the extent, here {', '.join(lengths)}",
        "start": _start(variant),
        "relight_frame": "light maps with Y up, as the published code reads them" if variant.frame == "as_shipped"
        else "light maps as their files say (published: with Y up)",
    }  # fmt: skip
    return labels | reduced(
        budget, PAPER, "inverse_iterations", "azimuths", "heights", "march_steps", "light_height", "render_azimuths",
        "render_heights",
    )  # fmt: skip


def _start(variant: Variant) -> str:
    begin = f"marches begin at {variant.start} of 16 steps"
    if variant.readme_bug:
        return f"{begin} where images are shown, at {variant.training_start} in training, as the README's command says"
    return f"{begin} (published: 8; its README's command trains with 64, which finds nothing)"
