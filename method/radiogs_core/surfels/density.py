"""Adaptive density control: clone what is small and pulled, split what is large and pulled, prune the faint.

3DGS's rules and thresholds. A surfel that no view felt since the last round is pruned too: it faces away from every
camera or is buried, would never be seen again, and would still stand in the way of traced rays. Two changes make the
rules independent of the image's size and of the run's
length: the pull is measured in half-image units at the surfel's centre, and the number of surfels has a ceiling.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..scene.camera import Camera
from .surfels import Surfels

GRADIENT_THRESHOLD = 2e-4
"""Mean pull, in loss per half-image, above which a surfel is densified."""

SMALL_SCALE = 0.01
"""Scale, in scene extents, up to which a pulled surfel is cloned rather than split."""

LARGE_SCALE = 0.1
"""Scale, in scene extents, above which a surfel is pruned."""

OPACITY_FLOOR = 0.05
SPLIT_SHRINK = 1.6
"""Children of a split are this much smaller than their parent."""


@dataclass
class Pull:
    """How strongly the images want each surfel to move: mean over the views that see it."""

    total: Float[Tensor, " surfels"]
    seen: Float[Tensor, " surfels"]

    @classmethod
    def none(cls, count: int, device: torch.device) -> "Pull":
        """No observation yet."""
        return cls(torch.zeros(count, device=device), torch.zeros(count, device=device))

    def observe(
        self,
        camera: Camera,
        centre: Float[Tensor, "surfels 3"],
        gradient: Float[Tensor, "surfels 3"],
        touched: Bool[Tensor, " surfels"],
    ) -> None:
        """Add one view's loss gradient with respect to the world centres, as a gradient on the screen.

        A shift of one half-image at depth z is z W / (2 fx) world units along the camera's right axis.
        """
        depth = camera.depth_of(centre).abs()
        across = (gradient @ camera.axes[:, 0]) * depth * (camera.width / (2 * camera.fx))
        down = (gradient @ camera.axes[:, 1]) * depth * (camera.height / (2 * camera.fy))
        self.total += torch.where(touched, torch.hypot(across, down), 0.0)
        self.seen += touched

    def mean(self) -> Float[Tensor, " surfels"]:
        """Mean pull; zero for a surfel that no view saw."""
        return self.total / self.seen.clamp(min=1)


def densify_and_prune(
    surfels: Surfels, pull: Pull, extent: float, maximum: int, generator: torch.Generator
) -> tuple[Surfels, Tensor]:
    """One round of density control.

    Returns the new surfels and, for each, the index of the old surfel whose optimiser moments it inherits (-1
    for fresh ones). The strongest pulls go first when ``maximum`` leaves no room for all.
    """
    largest = surfels.scale.max(-1).values
    felt = pull.total > 0
    keep = felt & (surfels.opacity >= OPACITY_FLOOR) & (largest <= LARGE_SCALE * extent)
    strength = pull.mean()
    room = max(0, maximum - int(keep.sum()))
    wanted = torch.nonzero(keep & (strength > GRADIENT_THRESHOLD))[:, 0]
    wanted = wanted[strength[wanted].argsort(descending=True, stable=True)][:room]
    small = largest[wanted] <= SMALL_SCALE * extent
    clone, split = wanted[small], wanted[~small]

    stay = keep.clone()
    stay[split] = False
    stayers = torch.nonzero(stay)[:, 0]
    parts = [surfels.take(stayers), surfels.take(clone), *_children(surfels.take(split), generator)]
    fresh = torch.full((len(clone) + 2 * len(split),), -1, dtype=torch.long, device=stayers.device)
    return concatenate(parts), torch.cat([stayers, fresh])


def _children(parents: Surfels, generator: torch.Generator) -> list[Surfels]:
    """Two smaller surfels per parent, at offsets drawn from the parent's own Gaussian, within its plane."""
    children = []
    for _ in range(2):
        offset = torch.randn(
            len(parents), 2, generator=generator, dtype=parents.centre.dtype, device=parents.centre.device
        )
        child = parents.take(torch.arange(len(parents), device=parents.centre.device))
        child.centre = parents.centre + torch.einsum("nij,nj->ni", parents.frame[..., :2], offset * parents.scale)
        child.log_scale = parents.log_scale - torch.log(torch.tensor(SPLIT_SHRINK)).item()
        children.append(child)
    return children


def concatenate(parts: list[Surfels]) -> Surfels:
    """All surfels of ``parts``, in order."""
    named = [part.parameters() for part in parts]
    return Surfels.of({name: torch.cat([part[name] for part in named]) for name in named[0]})
