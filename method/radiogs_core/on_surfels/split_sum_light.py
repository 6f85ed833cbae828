"""Split-sum shading of surface points: diffuse and specular part, two lookup frames, and metallic surfaces."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from ..kernels.shade.brdf import FRESNEL_NORMAL
from ..transport.prefiltered_light import Masking, PrefilteredLight, brdf_table, split_sum_radiance

Frame = Literal["oriented", "as_shipped"]
"""Frame in which a light map is looked up: "oriented" is its own frame, Z up; "as_shipped" is a lookup for Y up along
unchanged directions, as in the published codes of GS-IR and GI-GS."""


@dataclass(frozen=True)
class Reflected:
    """Linear radiance towards the camera under unoccluded distant light; zero for points seen from behind."""

    diffuse: Float[Tensor, "points 3"]
    """Diffuse part, linear RGB."""
    specular: Float[Tensor, "points 3"]
    """Specular part, linear RGB."""

    @property
    def radiance(self) -> Float[Tensor, "points 3"]:
        """Sum of both parts, without occlusion."""
        return self.diffuse + self.specular

    def occluded(self, openness: Float[Tensor, " points"]) -> Float[Tensor, "points 3"]:
        """Sum of both parts, with the diffuse part times ``openness``; the specular part is never occluded."""
        return self.diffuse * openness[:, None] + self.specular


@dataclass(frozen=True)
class SplitSumLight:
    """A prefiltered light and its lookup frame."""

    filtered: PrefilteredLight
    """The prefiltered light."""
    frame: Frame = "oriented"
    """The lookup frame."""

    def ready(self) -> "SplitSumLight":
        """This light, with its maps computed now: the first frame, which is timed, must not wait for them."""
        _ = self.filtered.both
        return self

    def along(self, direction: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
        """World directions in the lookup frame: (-z, -x, y) for "as_shipped".

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
        """Diffuse part albedo E(normal) and specular part S(mirrored, roughness) (F0 A + B), with gradient to all.

        normal, outgoing: unit, in the world. albedo: linear. roughness: perceptual. metallic: in [0, 1], see
        ``normal_reflectance``; None: F0 = 0.04.
        """
        # Rotated directions under the map give the same radiance as world directions under the map rotated back.
        diffuse, specular = split_sum_radiance(
            self.along(normal), albedo, roughness, self.along(outgoing), self.filtered
        )
        if metallic is not None:
            specular = specular * metallic_factor(
                albedo, roughness, metallic, (normal * outgoing).sum(-1), self.filtered.masking
            )
        return Reflected(diffuse, specular)


def normal_reflectance(
    albedo: Float[Tensor, "points 3"], metallic: Float[Tensor, " points"]
) -> Float[Tensor, "points 3"]:
    """Reflectance at normal incidence, F0 = 0.04 (1 - m) + m albedo, linear RGB; m: ``metallic``, in [0, 1]."""
    return FRESNEL_NORMAL * (1 - metallic[:, None]) + metallic[:, None] * albedo


def metallic_factor(
    albedo: Float[Tensor, "points 3"],
    roughness: Float[Tensor, " points"],
    metallic: Float[Tensor, " points"],
    cosine: Float[Tensor, " points"],
    masking: Masking = "schlick",
) -> Float[Tensor, "points 3"]:
    """(F0 A + B) / (0.04 A + B): the factor from a dielectric specular lobe to that of ``normal_reflectance``.

    1 where the lobe is zero, at exactly grazing views. ``cosine``: n.wo.
    """
    scale, bias = brdf_integrals(cosine, roughness, masking).unbind(-1)
    dielectric = FRESNEL_NORMAL * scale + bias
    some = dielectric > 0
    lobe = normal_reflectance(albedo, metallic) * scale[:, None] + bias[:, None]
    return torch.where(some[:, None], lobe / torch.where(some, dielectric, 1.0)[:, None], 1.0)


def brdf_integrals(
    cosine: Float[Tensor, " points"], roughness: Float[Tensor, " points"], masking: Masking = "schlick"
) -> Float[Tensor, "points 2"]:
    """A and B of ``brdf_table``, bilinear in ``cosine`` (n.wo) and ``roughness``, with gradient to both."""
    table = brdf_table(masking).to(roughness)
    last = len(table) - 1
    (row, below), (column, beyond) = (_cell(value, last) for value in (cosine, roughness))
    upper, lower = (
        table[at, column] + beyond * (table[at, column + 1] - table[at, column]) for at in (row, row + 1)
    )  # fmt: skip
    return upper + below * (lower - upper)


def _cell(value: Float[Tensor, " points"], last: int) -> tuple[Tensor, Tensor]:
    """Index of the table entry at or below a value in [0, 1], and the fraction, [points, 1], to the next entry."""
    position = value.clamp(0, 1) * last
    entry = position.detach().floor().clamp(max=last - 1)
    return entry.long(), (position - entry)[:, None]
