"""One model of each method with values set by hand: a ball under a roof, seen by a small scene's cameras."""

from collections.abc import Callable
from dataclasses import replace

import torch

from baselines.methods.gs_ir.world import lit
from baselines.methods.irgs.world import DOWN, grey, sheet, together
from baselines.methods.r3dg.world import around
from baselines.methods.stage_two import GI_GS, GS_IR, IRGS, R3DG, STANDING, SVG_IR
from baselines.methods.stage_two import UNSEEN as HIGH_ROOF
from baselines.methods.svg_ir.world import model_of as svg_ir_model
from baselines.methods.tensoir import world as tensoir_world
from known_ball import BALL
from radiogs_baselines.methods.gi_gs.method import GI_GS_METHOD
from radiogs_baselines.methods.gi_gs.settings import Variant as GIGSVariant
from radiogs_baselines.methods.gi_gs.showing import TrainedGIGS
from radiogs_baselines.methods.gs_ir.method import GS_IR_METHOD
from radiogs_baselines.methods.gs_ir.model import Model as GSIRModel
from radiogs_baselines.methods.gs_ir.settings import Variant as GSIRVariant
from radiogs_baselines.methods.gs_ir.showing import TrainedGSIR
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_baselines.methods.gs_ir.volumes import Lattice
from radiogs_baselines.methods.irgs.method import IRGS_METHOD
from radiogs_baselines.methods.irgs.settings import Variant as IRGSVariant
from radiogs_baselines.methods.irgs.showing import TrainedIRGS
from radiogs_baselines.methods.metallic import MetallicSurfels
from radiogs_baselines.methods.r3dg.method import R3DG_METHOD
from radiogs_baselines.methods.r3dg.model import Model as R3DGModel
from radiogs_baselines.methods.r3dg.settings import Variant as R3DGVariant
from radiogs_baselines.methods.r3dg.showing import TrainedR3DG
from radiogs_baselines.methods.svg_ir.method import SVG_IR_METHOD
from radiogs_baselines.methods.svg_ir.settings import Variant as SVGIRVariant
from radiogs_baselines.methods.svg_ir.showing import TrainedSVGIR
from radiogs_baselines.methods.tensoir.method import TENSOIR_METHOD
from radiogs_baselines.methods.tensoir.settings import Variant as TensoIRVariant
from radiogs_baselines.methods.tensoir.showing import TrainedTensoIR
from radiogs_core.contract import Trained
from radiogs_core.on_surfels.model import LitSurfels as IRGSModel

WHITE = torch.zeros(8, 16, 3)
"""Log-radiance of a constant light of 1."""

LOW_ROOF = together(BALL, sheet(1.5, DOWN, scale=0.5, radiance=0.4))
LATTICE = Lattice.over(LOW_ROOF, 16)
VOLUMES = {"occlusion": bake(LOW_ROOF, LATTICE, Reach(), 64), "irradiance": lit(0.4, LATTICE)}
FLOOR = tensoir_world.made_of(tensoir_world.floor_field(top=-0.5), radiance=0.3, albedo=0.4, upward=True)


def irgs(turned: IRGSVariant | None = None) -> TrainedIRGS:
    """IRGS with a high roof."""
    return IRGS_METHOD.restore(IRGS.run_of(turned), IRGSModel(HIGH_ROOF, WHITE).tensors())


def r3dg(turned: R3DGVariant | None = None) -> TrainedR3DG:
    """R3DG with local light of 0.2."""
    model = R3DGModel(HIGH_ROOF, around(HIGH_ROOF, 0.2), WHITE)
    return R3DG_METHOD.restore(R3DG.run_of(turned), model.tensors())


def svg_ir(turned: SVGIRVariant | None = None) -> TrainedSVGIR:
    """SVG-IR with a low roof."""
    return SVG_IR_METHOD.restore(SVG_IR.run_of(turned), svg_ir_model(LOW_ROOF, grey()).tensors())


def gs_ir_model(**changes: object) -> GSIRModel:
    """GS-IR with a low roof and both volumes; some fields may be changed."""
    return replace(GSIRModel(LOW_ROOF, WHITE, **VOLUMES), **changes)  # type: ignore[arg-type]


def gs_ir(turned: GSIRVariant | None = None, **changes: object) -> TrainedGSIR:
    """``gs_ir_model`` as a trained model."""
    return GS_IR_METHOD.restore(GS_IR.run_of(turned), gs_ir_model(**changes).tensors())


def gi_gs(turned: GIGSVariant | None = None, metallic: torch.Tensor | None = None) -> TrainedGIGS:
    """GI-GS with a ball on a floor."""
    return GI_GS_METHOD.restore(GI_GS.run_of(turned), MetallicSurfels(STANDING, WHITE, metallic).tensors())


def tensoir(turned: TensoIRVariant | None = None) -> TrainedTensoIR:
    """TensoIR with a floor."""
    return TENSOIR_METHOD.restore(tensoir_world.run_of(turned), tensoir_world.model_of(FLOOR, 0.8).tensors())


MODELS: dict[str, Callable[[], Trained]] = {
    "gs-ir": gs_ir,
    "gi-gs": gi_gs,
    "irgs": irgs,
    "r3dg": r3dg,
    "svg-ir": svg_ir,
    "tensoir": tensoir,
}
"""A trained model of each method, by name."""
