"""Deferred split-sum shading of seen points: L_o = a (O E(n) + (1 - O) I) + S (F0 A + B).

O occludes the diffuse part alone. Normals and places have no gradient.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.shade.brdf import FRESNEL_NORMAL
from radiogs_core.transport.splitsum import PrefilteredLight, brdf_table, split_sum_radiance

from ..seen_points import SeenPoints
from .variant import Frame


@dataclass(frozen=True)
class SplitSumLight:
    """A filtered light and the frame that it is looked up in (see ``Frame``)."""

    filtered: PrefilteredLight
    frame: Frame = "oriented"

    def along(self, direction: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """World directions as the map is looked up: for "as_shipped", (-z, -x, y).

        The lookup for Y up reads u = 1/2 + atan2(x, -z) / 2 pi and v = acos(y) / pi; the map, Z up, has that texel
        along (-z, -x, y) (see ``scene.light``).
        """
        if self.frame == "oriented":
            return direction
        x, y, z = direction.unbind(-1)
        return torch.stack([-z, -x, y], -1)


@dataclass(frozen=True)
class Shaded:
    """Outgoing radiance of points towards the camera, linear: after one surface, and after more."""

    direct: Float[Tensor, "points 3"]
    indirect: Float[Tensor, "points 3"]

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """All of it."""
        return self.direct + self.indirect


def shade_points(
    points: SeenPoints,
    light: SplitSumLight,
    openness: Float[Tensor, " points"] | None = None,
    irradiance: Float[Tensor, " points"] | None = None,
    metallic: Float[Tensor, " points"] | None = None,
) -> Shaded:
    """The points under a light; zero where the camera looks from below the surface.

    openness: O, None: 1. irradiance: I, over pi and gray, None: 0. metallic: None: F0 = 0.04.
    """
    normal, outgoing = points.normal.detach(), points.outgoing
    # The split sum turns with its light: turned directions under the map are the map, turned back, over the world.
    diffuse, specular = split_sum_radiance(
        light.along(normal), points.albedo, points.roughness, light.along(outgoing), light.filtered
    )
    cosine = (normal * outgoing).sum(-1)
    if metallic is not None:
        specular = specular * metallic_factor(points.albedo, points.roughness, metallic, cosine)
    if openness is None:
        return Shaded(diffuse + specular, torch.zeros_like(diffuse))
    direct = openness[:, None] * diffuse + specular
    if irradiance is None:
        return Shaded(direct, torch.zeros_like(diffuse))
    arriving = torch.where(cosine > 0, (1 - openness) * irradiance, 0.0)
    return Shaded(direct, points.albedo * arriving[:, None])


def metallic_factor(
    albedo: Float[Tensor, "points 3"],
    roughness: Float[Tensor, " points"],
    metallic: Float[Tensor, " points"],
    cosine: Float[Tensor, " points"],
) -> Float[Tensor, "points 3"]:
    """(F0 A + B) / (0.04 A + B) with F0 = 0.04 (1 - m) + m albedo: what turns the kernel's lobe into that of F0.

    1 where the table has no lobe at all, that is, seen exactly from the edge.
    """
    scale, bias = brdf_integrals(cosine, roughness).unbind(-1)
    mixed = FRESNEL_NORMAL * (1 - metallic[:, None]) + metallic[:, None] * albedo
    dielectric = FRESNEL_NORMAL * scale + bias
    some = dielectric > 0
    factor = (mixed * scale[:, None] + bias[:, None]) / torch.where(some, dielectric, 1.0)[:, None]
    return torch.where(some[:, None], factor, 1.0)


def brdf_integrals(cosine: Float[Tensor, " points"], roughness: Float[Tensor, " points"]) -> Float[Tensor, "points 2"]:
    """A and B of ``splitsum.brdf_table`` at n.wo and roughness, bilinear; gradient to both."""
    table = brdf_table().to(roughness)
    last = len(table) - 1
    (row, below), (column, beyond) = (_cell(value, last) for value in (cosine, roughness))
    upper, lower = (
        table[at, column] + beyond * (table[at, column + 1] - table[at, column]) for at in (row, row + 1)
    )  # fmt: skip
    return upper + below * (lower - upper)


def _cell(value: Float[Tensor, " points"], last: int) -> tuple[Tensor, Tensor]:
    """The entry of a table at or below a value in [0, 1], and the share [points, 1] of the way to the next."""
    place = value.clamp(0, 1) * last
    entry = place.detach().floor().clamp(max=last - 1)
    return entry.long(), (place - entry)[:, None]
