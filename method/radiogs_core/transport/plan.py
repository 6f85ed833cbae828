"""The effect plan: which light-transport effects are simulated, and which substitutes replace the others."""

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
    traced: Bool[Tensor, " surfels"] | None = field(default=None, compare=False)
    """Surfels whose V and L_ind are traced if either effect is on; the others have both substitutes. None: all."""
    specular_at: Bool[Tensor, " surfels"] | None = field(default=None, compare=False)
    """Surfels that have a specular lobe if ``specular`` is on. None: all."""
    kept: bool = False
    """Whether surfels that are not traced keep the light that was traced when the plan was made, instead of the
    substitutes. If only L_ind is off, occluders keep the radiance that they had then."""

    @property
    def traces(self) -> bool:
        """Whether the plan needs any ray."""
        return self.visibility or self.indirect

    @property
    def traces_all(self) -> bool:
        """Whether every surfel has V and L_ind from rays."""
        return self.visibility and self.indirect and self.traced is None

    @property
    def at_once(self) -> "EffectPlan":
        """The plan for the first trace if its light is kept: it traces V and L_ind of all surfels."""
        return replace(self, visibility=True, indirect=True, traced=None) if self.kept else self

    @property
    def off(self) -> tuple[str, ...]:
        """Names of the effects that are off or simulated only in part."""
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

    def traced_among(self, index: Int[Tensor, " chosen"]) -> Int[Tensor, " positions"]:
        """The positions in ``index`` of the surfels from which rays are traced."""
        if not self.traces:
            return index[:0]
        if self.traced is None:
            return torch.arange(len(index), device=index.device)
        return torch.nonzero(self.traced[index])[:, 0]

    def without_rays(self, like: Float[Tensor, "surfels _"]) -> Bool[Tensor, " surfels"]:
        """Whether no ray is traced from each surfel. ``like``: a tensor with as many rows, same device."""
        if self.traces and self.traced is not None:
            return ~self.traced
        return torch.full((len(like),), not self.traces, device=like.device)

    def specular_among(self, like: Float[Tensor, "surfels _"]) -> Bool[Tensor, " surfels"] | None:
        """Whether each surfel has a specular lobe; None: all. ``like``: a tensor with as many rows, same device."""
        if self.specular:
            return self.specular_at
        return torch.zeros(len(like), dtype=torch.bool, device=like.device)

    def state(self) -> dict[str, Any]:
        """The fields as plain values and tensors, for checkpoints."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    def plain(self) -> dict[str, Any]:
        """The fields as plain values, for results; a mask becomes the share of surfels that it selects."""
        shares = {
            name: None if mask is None else float(mask.float().mean())
            for name, mask in (("traced", self.traced), ("specular_at", self.specular_at))
        }
        return self.state() | shares


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
