"""Adapters of all surfel methods for the shared tests: stage 2 on a known ball, and maps of any surfels."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from baselines.methods.gi_gs import world as gi_gs
from baselines.methods.gs_ir import world as gs_ir
from baselines.methods.irgs import world as irgs
from baselines.methods.r3dg import world as r3dg
from baselines.methods.stage_two import GI_GS, GS_IR, IRGS, R3DG, SVG_IR, StageTwo
from baselines.methods.svg_ir import world as svg_ir
from known_ball import BALL
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_baselines.methods.gs_ir.volumes import IrradianceVolume, Lattice
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from short_training import through_a_file

Maps = Mapping[str, Tensor]

RESUMED = irgs.together(BALL, irgs.sheet(1.4, irgs.DOWN, scale=0.8, opacity=0.95, radiance=0.4))
"""The ball under a lid 0.4 above its top with radiance towards it."""


def assert_finite(maps: Maps) -> None:
    """Every value of every map is finite."""
    assert all(bool(torch.isfinite(value).all()) for value in maps.values())


def same(one: Any, other: Any) -> bool:
    """Whether two states are equal, bit for bit."""
    if isinstance(one, torch.Tensor):
        return isinstance(other, torch.Tensor) and torch.equal(one, other)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


def assert_resumes(begin: Callable[[], Any], at: int, steps: int) -> Any:
    """A stage restored from its state after ``at`` steps ends as one without interruption, which is returned."""
    whole, resumed = begin(), begin()
    for step in range(steps):
        if step == at:
            saved = through_a_file(whole.state())
        whole.step()
    resumed.restore(saved)
    while resumed.iteration < steps:
        resumed.step()
    assert same(whole.state(), resumed.state())
    assert same(whole.product(), resumed.product())
    return whole


@dataclass(frozen=True)
class MethodAdapter:
    """Adapter of a surfel method for the shared tests."""

    training: StageTwo
    """Stage 2 on a known ball."""
    shown: Callable[[Surfels, Camera, float], list[Maps]]
    """Renders maps under a recovered light of random texels and, for some methods, relit by a grey light. The last
    argument is a factor on all lengths of the method."""
    lights_itself: bool
    """Whether a single surfel may receive indirect light."""
    tolerance: tuple[float, float] = (1e-3, 0.01)
    """Tolerance of pixels in a scaled world, and the share of pixels that may exceed it."""
    learnt: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the variant in tests of single steps, with which the method learns all its parameters."""
    seen_alone: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the variant with which only the images and the light have losses."""
    silent: tuple[str, ...] = ()
    """Names of the losses that are zero if no surfel is seen."""


def random_light() -> EnvironmentMap:
    """A light with independent random texels, the same at each call."""
    return EnvironmentMap(torch.randn(8, 16, 3, generator=torch.Generator().manual_seed(4)).exp())


def by_irgs(surfels: Surfels, camera: Camera, scale: float) -> list[Maps]:
    """Maps by IRGS; rays start at a share of each surfel's size."""
    model = irgs.trained(surfels, random_light(), 16, ray_start=None, two_sided=True)
    return [dict(model.prepare(light).render(camera)) for light in (None, irgs.grey())]


def by_r3dg(surfels: Surfels, camera: Camera, scale: float) -> list[Maps]:
    """Maps by R3DG with random local light."""
    noise = torch.randn(len(surfels), 16, 3, generator=torch.Generator().manual_seed(5))
    local = r3dg.around(surfels, 0.1) + 0.1 * noise
    model = r3dg.trained(surfels, random_light(), local, 16, ray_start=None, two_sided=True)
    return [dict(model.prepare(light).render(camera)) for light in (None, irgs.grey())]


def by_gi_gs(surfels: Surfels, camera: Camera, scale: float) -> list[Maps]:
    """Maps by GI-GS with marches through the frame."""
    marches = gi_gs.march(thick=1.0)
    lengths = (scale * value for value in (marches.radius, marches.bias, marches.thick, marches.far))
    how = gi_gs.shader(marches=type(marches)(marches.grid, marches.distances, *lengths))
    return [gi_gs.shown(surfels, camera, gi_gs.light_of(random_light().radiance), how)]


def by_svg_ir(surfels: Surfels, camera: Camera, scale: float) -> list[Maps]:
    """Maps by SVG-IR with one-bounce radiance."""
    light = random_light()
    table = svg_ir.table_of(surfels, svg_ir.Walk(None, 0.01 * scale, 3.0 * scale, 0.2, 10.0), 16, 0)
    model = svg_ir.model_of(surfels, light)
    materials = svg_ir.materials_of(model, model.albedo)
    lit = table.with_radiance(svg_ir.bounced(materials, table, light.radiance, svg_ir.DISTANCE))
    return [svg_ir.Renderer(model, materials, svg_ir.Lit(light.radiance, lit, 1.0), svg_ir.DISTANCE).render(camera)]


def by_gs_ir(surfels: Surfels, camera: Camera, scale: float) -> list[Maps]:
    """Maps by GS-IR with occlusion and random irradiance; without surfels, the volumes are of a ball."""
    over = surfels if len(surfels) else BALL
    lattice = Lattice.over(over, 12)
    occlusion = bake(over, lattice, Reach(tau=scale), 64)
    coefficients = torch.randn(125, 9, generator=torch.Generator().manual_seed(5))
    model = gs_ir.model_of(
        surfels, random_light(), occlusion=occlusion, irradiance=IrradianceVolume(lattice.of(5), coefficients)
    )
    own = gs_ir.trained(model).prepare()
    return [dict(shown.render(camera)) for shown in (own, gs_ir.trained(gs_ir.model_of(surfels)).prepare(irgs.grey()))]


def images_alone() -> Any:
    """SVG-IR with only the losses of images and light: consistency and offsets change unseen surfels."""
    return SVG_IR.learning(weights=replace(SVG_IR.constant.weights, consistency=0.0, offset=0.0))


ADAPTERS: Mapping[str, MethodAdapter] = {
    "gs-ir": MethodAdapter(
        GS_IR,
        by_gs_ir,
        lights_itself=True,
        tolerance=(2e-3, 0.02),
        learnt={"metallic": True},
        silent=("smoothness", "prior"),
    ),
    "gi-gs": MethodAdapter(
        GI_GS, by_gi_gs, lights_itself=True, tolerance=(1e-3, 0.02), silent=("variation", "plainness")
    ),
    "irgs": MethodAdapter(
        IRGS, by_irgs, lights_itself=False, learnt={"lr_scale": 1.0}, silent=("shaded", "light prior")
    ),
    "r3dg": MethodAdapter(R3DG, by_r3dg, lights_itself=True),
    "svg-ir": MethodAdapter(SVG_IR, by_svg_ir, lights_itself=False, seen_alone={"materials": images_alone()}),
}
