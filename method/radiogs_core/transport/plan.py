"""The effect plan: which light-transport effects are simulated, and which substitutes replace the others."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..errors import UsageError

EFFECTS = {
    "visibility": "V is 1 above the horizon that neighbours make; without indirect light no ray is traced",
    "indirect": "L_ind is 0",
    "bounces": "light after more than one bounce is left out: L_ind is the split sum at the surface that a ray hits",
    "specular": "no lobe: its energy is scattered by Lambert's law",
    "light-sampling": "relighting draws no direction from the light",
    "view-dependence": "the surfels' own radiance is of degree 0",
    "samples": "half as many directions a surfel",
    "refresh": "all surfels are traced again half as often",
}
"""Effects by name, and the substitute when an effect is off. ``bounces`` and ``light-sampling`` concern relighting
only: training reads light after all bounces from the surfels at no cost, and draws no direction from the light."""

HIGHEST_DEGREE = 3
"""Degree of the harmonics of the surfels' own radiance."""

Effects = str | tuple[str, ...]
"""``"all"``, ``"auto"``, or the names of the effects that are on."""


@dataclass(frozen=True)
class EffectPlan:
    """The effects that are simulated; by default all of them (see ``EFFECTS``)."""

    visibility: bool = True
    """Whether V is traced."""
    indirect: bool = True
    """Whether L_ind is traced."""
    bounces: bool = True
    """Whether relighting simulates more than one bounce."""
    specular: bool = True
    """Whether surfels have a specular lobe."""
    light_sampling: bool = True
    """Whether relighting draws directions from the light."""
    sh_degree: int = HIGHEST_DEGREE
    """Degree of the harmonics of the surfels' own radiance."""
    samples: int = 1
    """Divisor of the number of directions of each surfel."""
    refresh: int = 1
    """Factor of the interval at which all surfels are traced again."""
    kept: bool = False
    """Whether surfels keep the light that was traced when the plan was made, instead of the substitutes."""

    @property
    def traces(self) -> bool:
        """Whether the plan needs any ray."""
        return self.visibility or self.indirect

    @property
    def traces_all(self) -> bool:
        """Whether both V and L_ind come from rays."""
        return self.visibility and self.indirect

    @property
    def at_once(self) -> "EffectPlan":
        """The plan that traces V and L_ind of a model whose light was kept in training."""
        return replace(self, visibility=True, indirect=True) if self.kept else self

    @property
    def off(self) -> tuple[str, ...]:
        """Names of the effects that are off."""
        left = {
            "visibility": self.visibility,
            "indirect": self.indirect,
            "bounces": self.bounces,
            "specular": self.specular,
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

    def specular_among(self, like: Float[Tensor, "surfels _"]) -> Bool[Tensor, " surfels"] | None:
        """Whether each surfel has a specular lobe; None: all. ``like``: a tensor with as many rows, same device."""
        return None if self.specular else torch.zeros(len(like), dtype=torch.bool, device=like.device)

    def state(self) -> dict[str, Any]:
        """The fields as plain values, for checkpoints and results."""
        return dict(vars(self))


def plan_of(effects: Effects) -> EffectPlan:
    """The plan that a variant starts with: all effects for ``"all"`` and ``"auto"``, or exactly the named ones."""
    if isinstance(effects, str):
        return EffectPlan()
    plan = EffectPlan()
    for name in EFFECTS:
        if name not in effects:
            plan = plan.without(name)
    return plan


def checked_effects(effects: str | Iterable[str]) -> Effects:
    """The value as a variant stores it, with names in the order of EFFECTS. Raises UsageError for an unknown effect."""
    wanted, known = ((effects,), ("all", "auto")) if isinstance(effects, str) else (tuple(effects), tuple(EFFECTS))
    for name in wanted:
        if name not in known:
            raise UsageError(
                f"unknown effect '{name}'",
                "The value is all, auto, or the names of the effects that are on.",
                f"Choose among: {', '.join(EFFECTS)}.",
            )
    return effects if isinstance(effects, str) else tuple(name for name in EFFECTS if name in wanted)
