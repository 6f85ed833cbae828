"""Density control adds and removes surfels while their geometry is learnt.

``AdaptiveDensityControl`` is the strategy of 3DGS: it clones small surfels with a large positional gradient, splits
large surfels with one, and prunes faint surfels. It also prunes

- surfels that no view has seen since the last round. They face away from every camera or are buried, so no view would
  see them again, and they would still occlude traced rays;
- at some steps, surfels that contribute little to every view. Without this a third to a half of all surfels would be
  such: they stop rays, emit a radiance that no image has constrained, and use up the maximum number of surfels.

Two changes make the rules independent of the image's size and of the run's length: the positional gradient is measured
in half-images at the surfel's centre, and the number of surfels has a maximum.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ..plain_values import require
from ..scene.camera import Camera
from .surfels import Surfels


@dataclass(frozen=True)
class OpacityResets:
    """Resets of all opacities at regular steps while density control acts; by default there are none.

    3DGS, 2DGS and the released code of RadioGS lower all opacities so that surfels which no image needs stay faint and
    are pruned. The released code also raises them, so that rays of the split sum do not pass through surfaces.
    """

    lower_every: float = 0.0
    """Share of the stage between two resets to ``lower_to`` at most; 0: none (3DGS: 3,000 steps)."""
    lower_to: float = 0.01
    """Largest opacity after a reset that lowers opacities (3DGS)."""
    raise_every: float = 0.0
    """Share of the stage between two resets to ``raise_to`` at least; 0: none (released code: 1,000 of 40,000 steps).
    A step that lowers opacities raises none."""
    raise_to: float = 0.9
    """Smallest opacity after a reset that raises opacities (released code)."""
    recovery: int = 400
    """Fewest steps between two resets that lower opacities. At 3DGS's rate, 0.05 in logits, an opacity needs 140 steps
    from 0.01 to 0.9. In a stage so short that ``lower_every`` is less, both intervals are longer by the same factor."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "lower_every", "raise_every")
        require(self, "above 0 and below 1", "lower_to", "raise_to")
        require(self, "one or above", "recovery")

    def lowers(self, iteration: int, iterations: int) -> bool:
        """Whether opacities are lowered after ``iteration`` of ``iterations`` steps."""
        return _at_multiple(iteration, self._longer(iterations) * self.lower_every * iterations)

    def raises(self, iteration: int, iterations: int) -> bool:
        """Whether opacities are raised after ``iteration`` of ``iterations`` steps."""
        raised = _at_multiple(iteration, self._longer(iterations) * self.raise_every * iterations)
        return raised and not self.lowers(iteration, iterations)

    def _longer(self, iterations: int) -> float:
        interval = self.lower_every * iterations
        return max(1.0, self.recovery / interval) if interval > 0 else 1.0

    def applied(self, surfels: Surfels, iteration: int, iterations: int) -> Surfels:
        """The surfels with the opacities after this step."""
        low, high = (torch.logit(surfels.opacity_logit.new_tensor(each)) for each in (self.lower_to, self.raise_to))
        if self.lowers(iteration, iterations):
            return replace(surfels, opacity_logit=surfels.opacity_logit.clamp(max=low))
        if self.raises(iteration, iterations):
            return replace(surfels, opacity_logit=surfels.opacity_logit.clamp(min=high))
        return surfels


ROUNDING = 1e-6
"""Difference, in steps, by which equal multiples of two intervals may differ in floating point."""


def _at_multiple(iteration: int, interval: float) -> bool:
    """Whether a step is the nearest one to a multiple of ``interval``, a half rounded down.

    Multiples are rounded, not the interval: else a shorter interval drifts past the longer one that it divides.
    """
    if interval <= 0 or iteration <= 0:
        return False
    interval = max(1.0, interval)
    multiple = round(iteration / interval) * interval
    return iteration == math.ceil(multiple - 0.5 - ROUNDING)


@dataclass(frozen=True)
class AdaptiveDensity:
    """When and where ``AdaptiveDensityControl`` acts. Scales are in scene extents (see ``Scene.extent``)."""

    start: float = 500 / 40_000
    """Share of the stage before which nothing is changed (released schedule: 500 of 40,000 iterations)."""
    end: float = 25_000 / 40_000
    """Share of the stage from which nothing is changed any more (released schedule: 25,000 of 40,000)."""
    gradient_threshold: float = 2e-4
    """Mean positional gradient, in loss per half-image, above which a surfel is cloned or split (3DGS)."""
    clone_scale: float = 0.01
    """Largest scale that is cloned; larger surfels are split (3DGS)."""
    largest_scale: float = 0.1
    """Scale above which a surfel is pruned (3DGS)."""
    opacity_floor: float = 0.05
    """Opacity below which a surfel is pruned (2DGS)."""
    split_shrink: float = 1.6
    """How many times smaller than their parent the two children of a split are (3DGS)."""
    hidden_at: tuple[float, ...] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0)
    """Shares of the stage after which surfels that hardly show in any training view are pruned."""
    least_contribution: float = 0.1
    """Sum of blending weights over the pixels of the view that shows most of a surfel below which it hardly shows."""
    prune_unseen: bool = True
    """Whether surfels that no view has seen since the last round are pruned (3DGS: no)."""
    resets: OpacityResets = field(default_factory=OpacityResets)
    """Resets of all opacities."""

    def __post_init__(self) -> None:
        require(self, "between 0 and 1", "start", "end", "opacity_floor", "hidden_at")
        require(self, "zero or above", "gradient_threshold", "clone_scale", "least_contribution")
        require(self, "above zero", "largest_scale", "split_shrink")


class AdaptiveDensityControl:
    """The adaptive density control of 3DGS; see the module.

    Args:
        rules: When and where the control acts.
        interval: Steps between two rounds.
        maximum: Largest number of surfels. If it does not allow all clones and splits, surfels with the largest
            positional gradients are chosen.
        extent: Extent of the scene, world units (see ``Scene.extent``).
        surfels: Surfels at the start.
        contribution: Returns each surfel's sum of blending weights in the view where that is largest, in pixels.
        stretch: Returns the factor by which surfels at world points may be larger than near the cameras
            (``Contraction.stretch``). No surfel where it is above 1 is pruned for its size, because a far wall may be a
            single surfel. None for a scene with masks.
    """

    def __init__(
        self,
        rules: AdaptiveDensity,
        interval: int,
        maximum: int,
        extent: float,
        surfels: Surfels,
        contribution: Callable[[Surfels], Float[Tensor, " surfels"]],
        stretch: Callable[[Float[Tensor, "surfels 3"]], Float[Tensor, " surfels"]] | None = None,
    ) -> None:
        self.rules, self.interval, self.maximum, self.extent = rules, interval, maximum, extent
        self.contribution, self.stretch = contribution, stretch
        self._forget(surfels)

    def _forget(self, surfels: Surfels) -> None:
        """Begin anew with statistics over no view, for these surfels."""
        self.total = torch.zeros(len(surfels), device=surfels.centre.device)
        """Norms of the gradients of each surfel's position on the screen, in loss per half-image, over all views."""
        self.views = torch.zeros_like(self.total)
        """How many views saw each surfel."""

    def observe(
        self,
        camera: Camera,
        centre: Float[Tensor, "surfels 3"],
        gradient: Float[Tensor, "surfels 3"],
        in_view: Bool[Tensor, " surfels"],
    ) -> None:
        """Add the step's view to the statistics: norms of positional gradients on the screen, and who was seen.

        A shift of one half-image at depth z is z W / (2 fx) world units along the camera's right axis. ``gradient``: of
        the loss with respect to the world positions ``centre``. ``in_view``: whether the view saw each surfel.
        """
        half = camera.axes.new_tensor([camera.width / (2 * camera.fx), camera.height / (2 * camera.fy)])
        on_screen = (gradient @ (camera.axes[:, :2] * half)).norm(dim=1) * camera.depth_of(centre).abs()
        self.total += torch.where(in_view, on_screen, 0.0)
        self.views += in_view

    def due(self, iteration: int, iterations: int) -> bool:
        """Whether to ``act`` after this step."""
        due = (self._grows, self._hides, self._resets)
        return any(each(iteration, iterations) for each in due)

    def _acts(self, iteration: int, iterations: int) -> bool:
        return self.rules.start <= iteration / iterations < self.rules.end

    def _grows(self, iteration: int, iterations: int) -> bool:
        return iteration % self.interval == 0 and self._acts(iteration, iterations)

    def _hides(self, iteration: int, iterations: int) -> bool:
        return iteration in {round(share * iterations) for share in self.rules.hidden_at}

    def _resets(self, iteration: int, iterations: int) -> bool:
        resets = self.rules.resets
        changes = resets.lowers(iteration, iterations) or resets.raises(iteration, iterations)
        return changes and self._acts(iteration, iterations)

    def act(
        self, surfels: Surfels, iteration: int, iterations: int, generator: torch.Generator
    ) -> tuple[Surfels, Int[Tensor, " surfels"]]:
        """Run a round, prune surfels that contribute little to every view, reset opacities, or all, as scheduled.

        A round clones, splits and prunes, and resets the statistics. Call it only where ``due`` is true. Returns the
        new surfels, and for each the index of the old surfel whose optimiser moments it inherits (-1: none).
        """
        shows = torch.ones_like(surfels.opacity, dtype=torch.bool)
        if self._hides(iteration, iterations):
            shows = self.contribution(surfels) >= self.rules.least_contribution
        if self._grows(iteration, iterations):
            changed, origin = self.changed_surfels(surfels, shows, generator)
            self._forget(changed)
        else:
            origin = torch.nonzero(shows)[:, 0]
            changed = surfels.take(origin)
            self.total, self.views = self.total[origin], self.views[origin]
        if self._resets(iteration, iterations):
            changed = self.rules.resets.applied(changed, iteration, iterations)
        return changed, origin

    def changed_surfels(
        self, surfels: Surfels, shows: Bool[Tensor, " surfels"], generator: torch.Generator
    ) -> tuple[Surfels, Int[Tensor, " changed"]]:
        """Surfels after a round, and for each the old surfel whose optimiser moments it inherits (-1: none)."""
        rules, extent = self.rules, self.extent
        largest, prunable = surfels.scale.max(-1).values, torch.ones_like(shows)
        if self.stretch is not None:
            stretch = self.stretch(surfels.centre)
            largest, prunable = largest / stretch, stretch <= 1
        seen = shows & (self.total > 0) if rules.prune_unseen else shows
        too_large = prunable & (largest > rules.largest_scale * extent)
        keep = seen & (surfels.opacity >= rules.opacity_floor) & ~too_large
        strength = self.total / self.views.clamp(min=1)
        room = max(0, self.maximum - int(keep.sum()))
        wanted = torch.nonzero(keep & (strength > rules.gradient_threshold))[:, 0]
        wanted = wanted[strength[wanted].argsort(descending=True, stable=True)][:room]
        small = largest[wanted] <= rules.clone_scale * extent
        clone, split = wanted[small], wanted[~small]

        stay = keep.clone()
        stay[split] = False
        stayers = torch.nonzero(stay)[:, 0]
        children = _children(surfels.take(split), rules.split_shrink, generator)
        parts = [surfels.take(stayers), surfels.take(clone), *children]
        fresh = torch.full((len(clone) + 2 * len(split),), -1, dtype=torch.long, device=stayers.device)
        return concatenate(parts), torch.cat([stayers, fresh])

    def state(self) -> dict[str, Any]:
        """The statistics since the last round."""
        return {"total": self.total, "views": self.views}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.total, self.views = state["total"], state["views"]


def _children(parents: Surfels, shrink: float, generator: torch.Generator) -> list[Surfels]:
    """Two smaller surfels per parent, at offsets drawn from the parent's own Gaussian, within its plane."""
    children = []
    for _ in range(2):
        offset = torch.randn(
            len(parents), 2, generator=generator, dtype=parents.centre.dtype, device=parents.centre.device
        )
        child = parents.take(torch.arange(len(parents), device=parents.centre.device))
        child.centre = parents.centre + torch.einsum("nij,nj->ni", parents.frame[..., :2], offset * parents.scale)
        child.log_scale = parents.log_scale - torch.log(torch.tensor(shrink)).item()
        children.append(child)
    return children


def concatenate(parts: list[Surfels]) -> Surfels:
    """All surfels of ``parts``, in order."""
    named = [part.parameters() for part in parts]
    return Surfels.of({name: torch.cat([part[name] for part in named]) for name in named[0]})
