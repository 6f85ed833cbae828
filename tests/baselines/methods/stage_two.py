"""Stage 2 of each method on surfels, on a known ball, starting from surfels that the test chooses."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import torch

from baselines.methods.irgs.world import DOWN, sheet, together
from known_ball import BALL, CPU, SCENE
from radiogs_baselines.methods.gi_gs.method import GI_GS_METHOD
from radiogs_baselines.methods.gs_ir.method import GS_IR_METHOD
from radiogs_baselines.methods.irgs.method import IRGS_METHOD
from radiogs_baselines.methods.r3dg.method import R3DG_METHOD
from radiogs_baselines.methods.svg_ir.method import SVG_IR_METHOD
from radiogs_core.contract import Run
from radiogs_core.on_surfels.method import SurfelMethod
from radiogs_core.surfels.surfels import Surfels
from scenes import surfels_facing

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")
Tensors = dict[str, torch.Tensor]


@dataclass(frozen=True)
class StageTwo:
    """Stage 2 of a method."""

    method: SurfelMethod[Any, Any]
    """The method."""
    surfels: Surfels = field(default_factory=lambda: BALL)
    """Surfels that it starts from, unless a test gives others."""
    numbers: Mapping[str, int] = field(default_factory=dict)
    """Numbers of the budget that differ from the preset smoke."""
    turned: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the variant that differ from the full method."""
    kept: Mapping[str, float] = field(default_factory=dict)
    """Weights of losses that ``only`` keeps."""

    @property
    def budget(self) -> Any:
        """The budget, with 100 iterations and a light of 8 rows."""
        return replace(self.method.presets["smoke"], inverse_iterations=100, light_height=8, **self.numbers)

    @property
    def constant(self) -> Any:
        """How materials are learnt from a constant light, which needs no search."""
        materials = self.method.variant().materials
        return replace(materials, start=replace(materials.start, light="constant"))

    def variant(self, **changes: Any) -> Any:
        """The full method with a constant initial light and some fields changed."""
        return self.method.variant(**{"materials": self.constant, **self.turned, **changes})

    def only(self, rates: Mapping[str, float] | None = None, **weights: float) -> Any:
        """Loss weights with these values; all other weights are zero. ``rates``: some rates, changed."""
        none = {each.name: 0.0 for each in fields(self.constant.weights)}
        return self.learning(rates, weights=replace(self.constant.weights, **(none | dict(self.kept) | weights)))

    def learning(self, rates: Mapping[str, float] | None = None, **changes: Any) -> Any:
        """``constant`` with some rates and other fields changed."""
        return replace(self.constant, rates=replace(self.constant.rates, **(rates or {})), **changes)

    def numbered(self, **numbers: Any) -> Any:
        """The budget with other numbers."""
        return replace(self.budget, **numbers)

    def run_of(self, turned: Any = None, budget: Any = None, scene: Any = SCENE) -> Run:
        """A run of a variant on the ball's images."""
        return Run(scene, turned or self.variant(), budget or self.budget, 0, CPU)

    def stage_of(self, turned: Any = None, surfels: Surfels | None = None, budget: Any = None) -> Any:
        """Stage 2 before its first step."""
        return self.method.begin(self.run_of(turned, budget), product_of(self.surfels if surfels is None else surfels))

    def restored(self, tensors: Mapping[str, Any], turned: Any = None) -> Any:
        """The trained model of these tensors."""
        return self.method.restore(self.run_of(turned), tensors)


def product_of(surfels: Surfels) -> dict[str, Any]:
    """Product of stage 1 that contains these surfels."""
    tensors = surfels.parameters() | {"sh": surfels.sh[:, :1], "sh_rest": surfels.sh[:, 1:]}
    return {"optimiser": {"tensors": tensors}}


def tensors_of(stage: Any) -> Tensors:
    """A copy of all learnt tensors, by name."""
    return {name: value.detach().clone() for name, value in stage.optimiser.tensors.items()}


def with_values(stage: Any, **tensors: torch.Tensor) -> Any:
    """The stage with some of its tensors replaced."""
    state = stage.state()
    state["optimiser"]["tensors"] = state["optimiser"]["tensors"] | tensors
    stage.restore(state)
    return stage


def stepped(stage: Any, steps: int = 1) -> tuple[Tensors, Tensors]:
    """The learnt tensors before and after some steps."""
    before = tensors_of(stage)
    for _ in range(steps):
        stage.step()
    return before, tensors_of(stage)


def changed_by(stage: Any, steps: int = 1) -> set[str]:
    """Names of the tensors that the next steps change."""
    before, after = stepped(stage, steps)
    return {name for name, value in after.items() if not torch.equal(value, before[name])}


def on_a_floor() -> Surfels:
    """The ball on a floor of tiles; every camera of the ball's scene sees both."""
    coordinate = torch.arange(-1.5, 1.6, 0.15)
    x, y = (values.flatten() for values in torch.meshgrid(coordinate, coordinate, indexing="ij"))
    normal = torch.tensor([0.0, 0.0, 1.0]).expand(len(x), 3)
    return together(BALL, surfels_facing(torch.stack([x, y, torch.full_like(x, -1.0)], -1), normal))


STANDING = on_a_floor()
UNSEEN = together(BALL, sheet(3.0, DOWN, scale=0.5, radiance=0.4))
"""The ball, and above it a sheet with radiance towards it that no camera sees; the sheet is the last surfel."""
CAPPED = together(BALL, sheet(1.4, DOWN, scale=0.8, opacity=0.95))
"""The ball under a lid 0.4 above its top; the lid is the last surfel."""

GS_IR = StageTwo(GS_IR_METHOD)
GI_GS = StageTwo(GI_GS_METHOD, STANDING, turned={"thick": 0.1})
"""Its marches hit the whole ball."""
IRGS = StageTwo(IRGS_METHOD, numbers={"pixels": 64, "incident_samples": 16})
R3DG = StageTwo(R3DG_METHOD, numbers={"incident_samples": 16})
SVG_IR = StageTwo(
    SVG_IR_METHOD,
    UNSEEN,
    numbers={"incident_samples": 16, "consistency_surfels": 10_000},
    turned={"hop": None},
    kept={"absolute": 0.9, "similarity": 0.1},
)
"""Its rays are long enough to reach the sheet."""

STAGES: Mapping[str, StageTwo] = {"gs-ir": GS_IR, "gi-gs": GI_GS, "irgs": IRGS, "r3dg": R3DG, "svg-ir": SVG_IR}
"""Stage 2 of every method on surfels."""
