"""One model of each method with values set by hand: a ball under a roof, seen by a small scene's cameras."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch

from baselines.methods.gs_ir.world import lit
from baselines.methods.irgs.world import DOWN, grey, sheet, together
from baselines.methods.r3dg.world import around
from baselines.methods.stage_two import GI_GS, GS_IR, IRGS, R3DG, STANDING, SVG_IR
from baselines.methods.stage_two import UNSEEN as HIGH_ROOF
from baselines.methods.svg_ir.world import model_of as svg_ir_model
from baselines.methods.tensoir import world as tensoir_world
from known_ball import BALL
from radiogs_baselines.methods.gs_ir.metallic import MetallicSurfels
from radiogs_baselines.methods.gs_ir.model import Model as GSIRModel
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_baselines.methods.gs_ir.volumes import Lattice
from radiogs_baselines.methods.r3dg.model import Model as R3DGModel
from radiogs_bench.methods import method
from radiogs_core.on_surfels.model import LitSurfels as IRGSModel

WHITE = torch.zeros(8, 16, 3)
"""Log-radiance of a constant light of 1."""

LOW_ROOF = together(BALL, sheet(1.5, DOWN, scale=0.5, radiance=0.4))
LATTICE = Lattice.over(LOW_ROOF, 16)
VOLUMES = {"occlusion": bake(LOW_ROOF, LATTICE, Reach(), 64), "irradiance": lit(0.4, LATTICE)}
FLOOR = tensoir_world.made_of(tensoir_world.floor_field(top=-0.5), radiance=0.3, albedo=0.4, upward=True)


def irgs(turned: Any = None) -> Any:
    """IRGS with a high roof."""
    return IRGS.restored(IRGSModel(HIGH_ROOF, WHITE).tensors(), turned)


def r3dg(turned: Any = None) -> Any:
    """R3DG with local light of 0.2."""
    model = R3DGModel(HIGH_ROOF, around(HIGH_ROOF, 0.2), WHITE)
    return R3DG.restored(model.tensors(), turned)


def svg_ir(turned: Any = None) -> Any:
    """SVG-IR with a low roof."""
    return SVG_IR.restored(svg_ir_model(LOW_ROOF, grey()).tensors(), turned)


def gs_ir_model(**changes: object) -> GSIRModel:
    """GS-IR with a low roof and both volumes; some fields may be changed."""
    return replace(GSIRModel(LOW_ROOF, WHITE, **VOLUMES), **changes)  # type: ignore[arg-type]


def gs_ir(turned: Any = None, **changes: object) -> Any:
    """``gs_ir_model`` as a trained model."""
    return GS_IR.restored(gs_ir_model(**changes).tensors(), turned)


def gi_gs(turned: Any = None, metallic: torch.Tensor | None = None) -> Any:
    """GI-GS with a ball on a floor."""
    return GI_GS.restored(MetallicSurfels(STANDING, WHITE, metallic).tensors(), turned)


def tensoir(turned: Any = None) -> Any:
    """TensoIR with a floor."""
    return method("tensoir").restore(tensoir_world.run_of(turned), tensoir_world.model_of(FLOOR, 0.8).tensors())


MODELS: dict[str, Callable[..., Any]] = {
    "gs-ir": gs_ir,
    "gi-gs": gi_gs,
    "irgs": irgs,
    "r3dg": r3dg,
    "svg-ir": svg_ir,
    "tensoir": tensoir,
}
"""A trained model of each method, by name."""
