"""Which effects are simulated, and what stands in the place of those that are not."""

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ..errors import UsageError

EFFECTS = {
    "visibility": "V is 1 above the horizon that neighbours make; without indirect light no ray is traced",
    "indirect": "L_ind is 0",
    "bounces": "light that has met more than one surface is left out: L_ind is the split sum at what a ray meets",
    "specular": "no lobe: its energy is scattered by Lambert's law",
    "light-sampling": "relighting draws no direction from the light",
    "view-dependence": "the surfels' own radiance is of degree 0",
    "samples": "half as many directions a surfel",
    "refresh": "all surfels are traced anew half as often",
}
"""Effects by name, and what off means. ``bounces`` and ``light-sampling`` concern relighting: training reads all
bounces off the surfels at no cost, and draws nothing from the light."""

HIGHEST_DEGREE = 3
MOST_REFRESH_FACTOR = 8

Effects = str | tuple[str, ...]
"""``"all"``, ``"auto"``, or the names of the effects that are on."""


@dataclass(frozen=True)
class EffectPlan:
    """What is simulated; the default is everything.

    traced: surfels whose V and L_ind are traced where either is on; the others have the substitutes of both. None: all.
    specular_at: surfels that have a specular lobe where it is on. None: all. sh_degree: of the surfels' own radiance.
    samples: divisor of the number of directions. refresh: factor of the interval at which all surfels are traced anew.
    kept: instead of substitutes, surfels that are not traced keep the light that was traced when the plan was made, and
    where L_ind is left out alone, what hides the sky stays as bright as it was.
    """

    visibility: bool = True
    indirect: bool = True
    bounces: bool = True
    specular: bool = True
    light_sampling: bool = True
    sh_degree: int = HIGHEST_DEGREE
    samples: int = 1
    refresh: int = 1
    traced: Bool[Tensor, " surfels"] | None = field(default=None, compare=False)
    specular_at: Bool[Tensor, " surfels"] | None = field(default=None, compare=False)
    kept: bool = False

    @property
    def traces(self) -> bool:
        """Whether any ray is needed."""
        return self.visibility or self.indirect

    @property
    def traces_all(self) -> bool:
        """Whether every surfel has V and L_ind from rays."""
        return self.visibility and self.indirect and self.traced is None

    @property
    def at_once(self) -> "EffectPlan":
        """The plan of a tracing whose light is kept: since it is the only one, with rays of all surfels."""
        return replace(self, visibility=True, indirect=True, traced=None) if self.kept else self

    @property
    def off(self) -> tuple[str, ...]:
        """The effects that are left out, or simulated in part, by name."""
        left = {
            "visibility": self.visibility and self.traced is None,
            "indirect": self.indirect and (self.traced is None or not self.visibility),
            "bounces": self.bounces,
            "specular": self.specular and self.specular_at is None,
            "light-sampling": self.light_sampling,
            "view-dependence": self.sh_degree == HIGHEST_DEGREE,
            "samples": self.samples == 1,
            "refresh": self.refresh == 1,
        }
        return tuple(name for name, on in left.items() if not on)

    def without(self, effect: str) -> "EffectPlan":
        """A copy of the plan with one effect replaced by its substitute."""
        changes: dict[str, dict[str, Any]] = {
            "visibility": {"visibility": False},
            "indirect": {"indirect": False},
            "bounces": {"bounces": False},
            "specular": {"specular": False},
            "light-sampling": {"light_sampling": False},
            "view-dependence": {"sh_degree": 0},
            "samples": {"samples": 2},
            "refresh": {"refresh": 2},
        }
        return replace(self, **changes[effect])

    def traced_among(self, index: Int[Tensor, " chosen"]) -> Int[Tensor, " places"]:
        """The places in ``index`` of the surfels that rays are traced from."""
        if not self.traces:
            return index[:0]
        if self.traced is None:
            return torch.arange(len(index), device=index.device)
        return torch.nonzero(self.traced[index])[:, 0]

    def without_rays(self, like: Float[Tensor, "surfels _"]) -> Bool[Tensor, " surfels"]:
        """Which of all surfels no ray is traced from. ``like`` says how many they are, and where."""
        if self.traces and self.traced is not None:
            return ~self.traced
        return torch.full((len(like),), not self.traces, device=like.device)

    def specular_among(self, like: Float[Tensor, "surfels _"]) -> Bool[Tensor, " surfels"] | None:
        """Which of all surfels have a specular lobe; None: all. ``like`` says how many they are, and where."""
        if self.specular:
            return self.specular_at
        return torch.zeros(len(like), dtype=torch.bool, device=like.device)

    def state(self) -> dict[str, Any]:
        """Plain values and tensors, for checkpoints."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def plain(self) -> dict[str, Any]:
        """Plain values alone, for results: of the masks the share of surfels that are on."""
        shares = {
            name: None if mask is None else float(mask.float().mean())
            for name, mask in (("traced", self.traced), ("specular_at", self.specular_at))
        }
        return self.state() | shares


def plan_of(effects: Effects) -> EffectPlan:
    """The plan that a variant begins with: everything, unless it names the effects that are on."""
    if isinstance(effects, str):
        return EffectPlan()
    plan = EffectPlan()
    for name in EFFECTS:
        if name not in effects:
            plan = plan.without(name)
    return plan


def checked_effects(effects: str | Iterable[str]) -> Effects:
    """The value as a variant keeps it: names in order. Raises UsageError for what is no effect."""
    if isinstance(effects, str):
        if effects not in ("all", "auto"):
            _refuse(effects)
        return effects
    wanted = tuple(effects)
    for name in wanted:
        if name not in EFFECTS:
            _refuse(name)
    return tuple(name for name in EFFECTS if name in wanted)


def _refuse(name: str) -> None:
    raise UsageError(
        f"unknown effect '{name}'",
        "Effects are given as all, auto, or the names of those that are on.",
        f"Effects: {', '.join(EFFECTS)}.",
    )
