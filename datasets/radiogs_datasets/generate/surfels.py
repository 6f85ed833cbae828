"""Surfels laid over the solids of a recipe, with their true materials: geometry that no reconstruction has blurred.

For comparing light transport through surfels with a path tracer's through the same solids.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from torch import Tensor

from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, roughness_to_logit
from radiogs_core.transport.sampling import GOLDEN_ANGLE, tangent_frame

from .catalogue import GAP, Box, Material, Solid, Sphere

OPACITY = 0.99
OVERLAP = 0.65
"""Standard deviation in steps of the grid: inside a face less of a ray's light passes than a solid surface lets through
(2.7 %, where four cells meet). More would blur: of coplanar surfels the one whose centre is nearer to the camera comes
first, which moves what is seen by about a third of a step."""

ROUGH = 0.99
"""Roughness of a room's walls; the logit of 1 is infinite."""

TOUCHING = 1.5 * GAP
"""Solids this near touch: what lies between them is seen by nobody."""


@dataclass(frozen=True)
class Patch:
    """Equal surfels in the world: centres, orthonormal frames (columns t_u, t_v, n; n outwards), scales."""

    centre: Float[Tensor, "surfels 3"]
    frame: Float[Tensor, "surfels 3 3"]
    scale: Float[Tensor, "surfels 2"]

    def where(self, kept: Bool[Tensor, " surfels"]) -> "Patch":
        """Some of them."""
        return Patch(self.centre[kept], self.frame[kept], self.scale[kept])

    def turned(self) -> "Patch":
        """The same, seen from the other side."""
        first, second, normal = self.frame.unbind(-1)
        return Patch(self.centre, torch.stack([second, first, -normal], -1), self.scale.flip(-1))


def surfels_over(solids: Sequence[Solid], spacing: float) -> Surfels:
    """Nearly opaque surfels, about ``spacing`` (world units) apart, all over the solids; radiance grey 1/2.

    Parts of a face on which another solid stands are left out. Float32.
    """
    parts = []
    for place, solid in enumerate(solids):
        others = [other for number, other in enumerate(solids) if number != place]
        for patch in _patches(solid, others, spacing):
            covered = torch.zeros(len(patch.centre), dtype=torch.bool)
            for other in others:
                covered |= _inside(other, patch.centre, TOUCHING)
            parts.append(_surfels(patch.where(~covered), solid))
    return _joined(parts)


def surfels_of_room(half_side: float, spacing: float, albedo: float) -> Surfels:
    """The inside of a closed cube around the origin: surfels that look inwards."""
    low, high = (-half_side,) * 3, (half_side,) * 3
    box = Box(low, high, Material((albedo, albedo, albedo), ROUGH))
    return _joined([_surfels(patch.turned(), box) for patch in _patches(box, [], spacing)])


def _joined(parts: Sequence[Surfels]) -> Surfels:
    return Surfels.of({name: torch.cat([part.parameters()[name] for part in parts]) for name in parts[0].parameters()})


def _surfels(patch: Patch, solid: Solid) -> Surfels:
    count = len(patch.centre)
    albedo = torch.tensor(solid.material.albedo, dtype=torch.float64)
    surfels = Surfels(
        centre=patch.centre,
        rotation=torch.from_numpy(Rotation.from_matrix(patch.frame.numpy()).as_quat(scalar_first=True)),
        log_scale=patch.scale.log(),
        opacity_logit=torch.full((count,), inverse_sigmoid(OPACITY)),
        sh=torch.zeros(count, COEFFICIENTS, 3),
        albedo_logit=torch.logit(albedo).expand(count, 3),
        roughness_logit=torch.full((count,), roughness_to_logit(solid.material.roughness)),
    )
    return Surfels.of({name: value.float().contiguous() for name, value in surfels.parameters().items()})


def _patches(solid: Solid, others: Sequence[Solid], spacing: float) -> list[Patch]:
    if isinstance(solid, Sphere):
        return [_sphere(solid, spacing)]
    return [_face(solid, others, spacing, axis, side) for axis, side in itertools.product(range(3), (0, 1))]


def _sphere(solid: Sphere, spacing: float) -> Patch:
    """A spherical Fibonacci lattice."""
    count = math.ceil(4 * math.pi * solid.radius**2 / spacing**2)
    place = torch.arange(count, dtype=torch.float64)
    height = 1 - (2 * place + 1) / count
    sine = (1 - height.square()).sqrt()
    normal = torch.stack([sine * (place * GOLDEN_ANGLE).cos(), sine * (place * GOLDEN_ANGLE).sin(), height], -1)
    step = solid.radius * math.sqrt(4 * math.pi / count)
    centre = torch.tensor(solid.centre, dtype=torch.float64) + solid.radius * normal
    return Patch(centre, tangent_frame(normal), torch.full((count, 2), OVERLAP * step, dtype=torch.float64))


def _face(solid: Box, others: Sequence[Solid], spacing: float, axis: int, side: int) -> Patch:
    """One side of a box; its grid has lines where boxes that touch it begin, so that cells are covered whole or not."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    plane = (solid.low, solid.high)[side][axis]
    near = [
        other for other in others
        if isinstance(other, Box) and other.low[axis] - TOUCHING <= plane <= other.high[axis] + TOUCHING
    ]  # fmt: skip
    steps = []
    for along in (first, second):
        low, high = solid.low[along], solid.high[along]
        cuts = {edge for other in near for edge in (other.low[along], other.high[along]) if low < edge < high}
        steps.append(_cells([low, *sorted(cuts), high], spacing))
    (u, du), (v, dv) = steps
    centre = torch.empty(len(u), len(v), 3, dtype=torch.float64)
    centre[..., first], centre[..., second], centre[..., axis] = u[:, None], v, plane
    scale = OVERLAP * torch.stack(torch.broadcast_tensors(du[:, None], dv), -1)
    unit = torch.eye(3, dtype=torch.float64)
    frame = torch.stack([unit[first], unit[second], unit[axis]], -1)
    count = len(u) * len(v)
    outwards = Patch(centre.view(count, 3), frame.expand(count, 3, 3), scale.reshape(count, 2))
    return outwards if side == 1 else outwards.turned()


def _cells(edges: Sequence[float], spacing: float) -> tuple[Float[Tensor, " cells"], Float[Tensor, " cells"]]:
    """Middles and widths of the cells between edges; they narrow to an eighth towards each, where Gaussians spill."""
    middles, widths = [], []
    for low, high in itertools.pairwise(edges):
        rim = spacing * torch.tensor([0.125, 0.25, 0.5], dtype=torch.float64)
        inner = high - low - 2 * float(rim.sum())
        if inner > 0:
            count = math.ceil(inner / spacing)
            width = torch.cat([rim, torch.full((count,), inner / count, dtype=torch.float64), rim.flip(0)])
        else:
            count = math.ceil((high - low) / float(rim[0]))
            width = torch.full((count,), (high - low) / count, dtype=torch.float64)
        middles.append(low + width.cumsum(0) - width / 2)
        widths.append(width)
    return torch.cat(middles), torch.cat(widths)


def _inside(solid: Solid, points: Float[Tensor, "points 3"], margin: float) -> Bool[Tensor, " points"]:
    if isinstance(solid, Sphere):
        return (points - torch.tensor(solid.centre, dtype=torch.float64)).norm(dim=-1) < solid.radius + margin
    low, high = (torch.tensor(corner, dtype=torch.float64) for corner in (solid.low, solid.high))
    return ((points > low - margin) & (points < high + margin)).all(-1)
