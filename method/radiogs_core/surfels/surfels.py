"""Gaussian surfels: their raw parameters, and the quantities that these are activated to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from operator import is_
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..errors import UsageError
from ..kernels.rasterize.projection import ProjectedSurfels, project_surfels
from ..kernels.surfel.footprint import frames, met_by_rays, widened
from ..kernels.surfel.geometry import SplatGeometry
from ..scene.camera import Camera
from .harmonics import COEFFICIENTS, CONSTANT_BASIS

ROUGHNESS_FLOOR = 0.05
"""Smallest roughness r: a GGX lobe (alpha = r^2) much narrower than a texel of the light cannot be learnt."""

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")
"""Raw parameters of where surfels are and how opaque they are."""


@dataclass
class Surfels:
    """N surfels by their raw parameters, which the optimiser changes."""

    centre: Float[Tensor, "surfels 3"]
    """Positions in the world, world units."""
    rotation: Float[Tensor, "surfels 4"]
    """Quaternions w, x, y, z of any non-zero length; the rotation's columns are t_u, t_v, n."""
    log_scale: Float[Tensor, "surfels 2"]
    """Natural logarithms of the standard deviations (s_u, s_v), in world units."""
    opacity_logit: Float[Tensor, " surfels"]
    """Logits of the peak opacity (see ``opacity``)."""
    sh: Float[Tensor, "surfels coefficients 3"]
    """Spherical harmonics of the outgoing radiance L_G, linear RGB, in the basis of 3DGS: 16 coefficients, or fewer if
    the higher degrees are left out."""
    albedo_logit: Float[Tensor, "surfels 3"]
    """Logits of the albedo (see ``albedo``)."""
    roughness_logit: Float[Tensor, " surfels"]
    """Logits of the roughness (see ``roughness``)."""

    def __len__(self) -> int:
        return self.centre.shape[0]

    @property
    def scale(self) -> Float[Tensor, "surfels 2"]:
        """Standard deviations along t_u and t_v, world units."""
        return self.log_scale.exp()

    @property
    def opacity(self) -> Float[Tensor, " surfels"]:
        """Peak opacity in (0, 1)."""
        return self.opacity_logit.sigmoid()

    @property
    def albedo(self) -> Float[Tensor, "surfels 3"]:
        """Linear diffuse albedo in (0, 1)."""
        return self.albedo_logit.sigmoid()

    @property
    def roughness(self) -> Float[Tensor, " surfels"]:
        """Perceptual roughness r in (ROUGHNESS_FLOOR, 1); alpha_GGX = r^2."""
        return ROUGHNESS_FLOOR + (1 - ROUGHNESS_FLOOR) * self.roughness_logit.sigmoid()

    @property
    def frame(self) -> Float[Tensor, "surfels 3 3"]:
        """Rotation matrices with columns t_u, t_v, n, in the world.

        The frame of a zero quaternion is zero. It has no tangents, so no pixel shows such a surfel and no ray hits it.
        """
        return frames(self.rotation)

    def with_cached_values(self) -> "Surfels":
        """A copy that keeps what several losses read, and its latest projection, for one step; gradients flow to these
        surfels."""
        return _Cached(**self.parameters())

    def geometry(self) -> SplatGeometry:
        """The geometry of the surfels for the ray tracer."""
        return met_by_rays(self.centre, self.frame, self.log_scale, self.opacity_logit)

    def geometry_for(self, camera: Camera) -> SplatGeometry:
        """The geometry for rasterization: widened to the footprint of a pixel (``kernels.surfel.footprint``)."""
        return widened(camera, self.centre, self.frame, self.scale, self.opacity)

    def seen_by(self, camera: Camera, radiance: bool, shown_only: bool = False) -> ProjectedSurfels:
        """The surfels projected into a camera, widened to the footprint of a pixel, with gradient to all parameters.

        ``radiance``: whether their own radiance towards the camera is wanted, too; ``shown_only``: it may be zero for
        surfels beside the image.
        """
        place = self.centre, self.rotation
        sh = self.sh if radiance else None
        return project_surfels(camera, place, self.log_scale, self.opacity_logit, sh, shown_only)

    def parameters(self) -> dict[str, Tensor]:
        """The raw tensors by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def plain(self) -> dict[str, Tensor]:
        """The raw tensors by name, without gradient history."""
        return {name: value.detach() for name, value in self.parameters().items()}

    @classmethod
    def of(cls, parameters: Mapping[str, Tensor]) -> "Surfels":
        """The inverse of ``parameters``."""
        return cls(**dict(parameters))

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the raw tensors."""
        return tuple(field.name for field in fields(cls))

    def with_material(self, albedo: float, roughness: float, opacity: float | None = None) -> "Surfels":
        """A copy of the surfels with a single material; ``opacity`` None keeps their opacity."""
        changes = {
            "albedo_logit": torch.full_like(self.albedo_logit, inverse_sigmoid(albedo)),
            "roughness_logit": torch.full_like(self.roughness_logit, roughness_to_logit(roughness)),
        }
        if opacity is not None:
            changes["opacity_logit"] = torch.full_like(self.opacity_logit, inverse_sigmoid(opacity))
        return replace(self, **changes)

    def detached(self, *names: str) -> "Surfels":
        """A copy without gradient to the named raw tensors: their gradients are not computed, and no step changes
        them."""
        return replace(self, **{name: getattr(self, name).detach() for name in names})

    def among(self, index: Int[Tensor, " chosen"]) -> "Surfels":
        """The surfels at ``index``, with gradient to these."""
        return Surfels(**{name: value[index] for name, value in self.parameters().items()})

    def take(self, index: Int[Tensor, " chosen"]) -> "Surfels":
        """The surfels at ``index``, without gradient history."""
        return Surfels(**{name: value.detach()[index] for name, value in self.parameters().items()})


class _Cached(Surfels):
    """Surfels whose parameters do not change: values that several losses read are computed once, and projected once.

    A value that was first read without gradient is computed again for a reader with gradient.
    """

    @property
    def frame(self) -> Float[Tensor, "surfels 3 3"]:
        return self._once("frame", lambda: frames(self.rotation))

    @property
    def albedo(self) -> Float[Tensor, "surfels 3"]:
        return self._once("albedo", lambda: super(_Cached, self).albedo)

    @property
    def roughness(self) -> Float[Tensor, " surfels"]:
        return self._once("roughness", lambda: super(_Cached, self).roughness)

    def _once(self, name: str, value: Callable[[], Tensor]) -> Tensor:
        kept: dict[tuple[str, bool], Tensor] = self.__dict__.setdefault("_values", {})
        key = name, torch.is_grad_enabled()
        if key not in kept:
            kept[key] = value()
        return kept[key]

    def seen_by(self, camera: Camera, radiance: bool, shown_only: bool = False) -> ProjectedSurfels:
        """``Surfels.seen_by``; a projection is used again for the same camera and tensors, with or without gradient."""
        of = (camera, shown_only, torch.is_grad_enabled(), *self.parameters().values())
        kept = self.__dict__.get("_kept")
        if kept is not None and all(map(is_, kept[0], of)) and (kept[1].radiance is not None or not radiance):
            return kept[1]
        seen = super().seen_by(camera, radiance, shown_only)
        self._kept = of, seen
        return seen


def surfels_at(
    points: Float[Tensor, "surfels 3"],
    spacing: Float[Tensor, " surfels"],
    seen_from: Float[Tensor, "surfels 3"],
    generator: torch.Generator,
) -> Surfels:
    """New surfels with random orientation: opacity 0.1, albedo 0.5, roughness 0.6, radiance 0.5.

    Normalised Gaussian quaternions are uniform over rotations; normalised samples of a cube are not.

    Args:
        points: Positions in the world.
        spacing: Standard deviation of each surfel in both directions, world units.
        seen_from: Positions in the world that the surfels' front sides face. A surfel that faces away from every camera
            has no gradient that would turn it.
        generator: Draws the orientations.
    """
    count = len(points)
    like: dict[str, Any] = {"dtype": points.dtype, "device": points.device}
    rotation = normalize(torch.randn(count, 4, generator=generator, **like), dim=-1)
    w, x, y, z = rotation.unbind(-1)
    normal = torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], -1)
    # Half a turn about t_u swaps the sides: q (0, 1, 0, 0) in quaternion product.
    turned = torch.stack([-x, w, z, -y], -1)
    away = ((seen_from - points) * normal).sum(-1, keepdim=True) < 0
    return Surfels(
        centre=points.clone(),
        rotation=torch.where(away, turned, rotation),
        log_scale=spacing.log()[:, None].repeat(1, 2),
        opacity_logit=torch.full((count,), inverse_sigmoid(0.1), **like),
        sh=torch.zeros(count, COEFFICIENTS, 3, **like),
        albedo_logit=torch.zeros(count, 3, **like),
        roughness_logit=torch.full((count,), roughness_to_logit(0.6), **like),
    )


def surfels_facing(
    points: Float[Tensor, "surfels 3"],
    spacing: Float[Tensor, " surfels"],
    normals: Float[Tensor, "surfels 3"],
) -> Surfels:
    """New surfels as by ``surfels_at``, with given unit ``normals``.

    Each is rotated from +Z to its normal by the shortest rotation (about X for a normal of -Z).
    """
    surfels = surfels_at(points, spacing, points + normals, torch.Generator(points.device).manual_seed(0))
    x, y, z = normals.unbind(-1)
    turn = torch.stack([1 + z, -y, x, torch.zeros_like(z)], -1)
    half = torch.tensor([0.0, 1.0, 0.0, 0.0]).to(turn)
    surfels.rotation = torch.where(turn.norm(dim=-1, keepdim=True) < 1e-3, half, normalize(turn, dim=-1))
    return surfels


def product(first: Float[Tensor, "*batch 4"], second: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """The quaternion of the rotation by ``second`` followed by the rotation by ``first``."""
    a, b = first[..., 1:], second[..., 1:]
    scalar = first[..., :1] * second[..., :1] - (a * b).sum(-1, keepdim=True)
    return torch.cat([scalar, first[..., :1] * b + second[..., :1] * a + torch.linalg.cross(a, b)], -1)


def inverse_sigmoid(value: float) -> float:
    """log(p / (1 - p)), for 0 < p < 1."""
    return float(torch.logit(torch.tensor(value, dtype=torch.float64)))


def require_roughness(settings: Any) -> None:
    """Raise UsageError unless the field ``roughness`` of ``settings`` lies between ROUGHNESS_FLOOR and 1."""
    if not ROUGHNESS_FLOOR < settings.roughness < 1:
        raise UsageError(f"roughness: {settings.roughness} is not above {ROUGHNESS_FLOOR} and below 1")


def roughness_to_logit(roughness: float) -> float:
    """The logit of a roughness between ROUGHNESS_FLOOR and 1."""
    return inverse_sigmoid((roughness - ROUGHNESS_FLOOR) / (1 - ROUGHNESS_FLOOR))


def radiance_to_sh(radiance: Float[Tensor, "surfels 3"]) -> Float[Tensor, "surfels 3"]:
    """The degree-0 coefficient of a surfel that sends the same linear radiance in all directions."""
    return (radiance - 0.5) / CONSTANT_BASIS
