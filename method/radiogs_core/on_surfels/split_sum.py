"""The split sum of what blends into surface points: the kernel's two parts, in one of two frames, with metal."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.shade.brdf import FRESNEL_NORMAL
from ..transport.splitsum import PrefilteredLight, brdf_table, split_sum_radiance

Frame = Literal["oriented", "as_shipped"]
"""How a new light is looked up: as its map is meant, Z up; or by a lookup for Y up along unchanged directions, as the
published codes of GS-IR and GI-GS do."""


@dataclass(frozen=True)
class Reflected:
    """Linear radiance towards the camera by unoccluded light from afar; zero where a point is seen from behind."""

    diffuse: Float[Tensor, "points 3"]
    specular: Float[Tensor, "points 3"]

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """Both parts, unoccluded."""
        return self.diffuse + self.specular

    def occluded(self, openness: Float[Tensor, " points"]) -> Float[Tensor, "points 3"]:
        """Both parts, where a share ``openness`` of the light reaches the point; lobes are never occluded."""
        return self.diffuse * openness[:, None] + self.specular


@dataclass(frozen=True)
class SplitSumLight:
    """A filtered light and the frame that it is looked up in (see ``Frame``)."""

    filtered: PrefilteredLight
    frame: Frame = "oriented"

    def ready(self) -> "SplitSumLight":
        """The same light with its maps made: the first frame, which is timed, must not wait for them."""
        _ = self.filtered.both
        return self

    def along(self, direction: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """World directions as the map is looked up: for "as_shipped", (-z, -x, y).

        The lookup for Y up reads u = 1/2 + atan2(x, -z) / 2 pi and v = acos(y) / pi; the map, Z up, has that texel
        along (-z, -x, y) (see ``scene.light``).
        """
        if self.frame == "oriented":
            return direction
        x, y, z = direction.unbind(-1)
        return torch.stack([-z, -x, y], -1)

    def reflected(
        self,
        normal: Float[Tensor, "points 3"],
        outgoing: Float[Tensor, "points 3"],
        albedo: Float[Tensor, "points 3"],
        roughness: Float[Tensor, " points"],
        metallic: Float[Tensor, " points"] | None = None,
    ) -> Reflected:
        """Albedo times E(normal), and S(mirrored, roughness) (F0 A + B); gradient to all.

        normal, outgoing: unit, in the world. metallic: see ``normal_reflectance``; None: F0 = 0.04.
        """
        # The split sum turns with its light: turned directions under the map are the map, turned back, over the world.
        diffuse, specular = split_sum_radiance(
            self.along(normal), albedo, roughness, self.along(outgoing), self.filtered
        )
        if metallic is not None:
            specular = specular * metallic_factor(albedo, roughness, metallic, (normal * outgoing).sum(-1))
        return Reflected(diffuse, specular)


def normal_reflectance(
    albedo: Float[Tensor, "points 3"], metallic: Float[Tensor, " points"]
) -> Float[Tensor, "points 3"]:
    """F0 = 0.04 (1 - m) + m albedo."""
    return FRESNEL_NORMAL * (1 - metallic[:, None]) + metallic[:, None] * albedo


def metallic_factor(
    albedo: Float[Tensor, "points 3"],
    roughness: Float[Tensor, " points"],
    metallic: Float[Tensor, " points"],
    cosine: Float[Tensor, " points"],
) -> Float[Tensor, "points 3"]:
    """(F0 A + B) / (0.04 A + B): what turns the kernel's lobe into that of ``normal_reflectance``.

    1 where the table has no lobe at all, that is, seen exactly from the edge.
    """
    scale, bias = brdf_integrals(cosine, roughness).unbind(-1)
    dielectric = FRESNEL_NORMAL * scale + bias
    some = dielectric > 0
    lobe = normal_reflectance(albedo, metallic) * scale[:, None] + bias[:, None]
    return torch.where(some[:, None], lobe / torch.where(some, dielectric, 1.0)[:, None], 1.0)


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
