"""Gaussian surfels: raw parameters, and the one place where they are turned into what they mean."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from ..kernels.surfel.footprint import frames, widened
from ..kernels.surfel.geometry import SplatGeometry
from ..scene.camera import Camera
from .harmonics import COEFFICIENTS, CONSTANT_BASIS

ROUGHNESS_FLOOR = 0.05
"""Smallest roughness r: a GGX lobe (alpha = r^2) much narrower than a texel of the light cannot be learnt."""

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")
"""Raw parameters of where surfels are and how opaque they are."""


@dataclass
class Surfels:
    """N surfels by their raw parameters (what the optimiser moves).

    centre: world units. rotation: quaternion w, x, y, z of any non-zero length; its columns are t_u, t_v, n.
    log_scale: log of (s_u, s_v), world units. sh: linear radiance, 3DGS basis; 16 coefficients, or those of the lower
    degrees alone. The logits are described by the properties that activate them.
    """

    centre: Float[Tensor, "surfels 3"]
    rotation: Float[Tensor, "surfels 4"]
    log_scale: Float[Tensor, "surfels 2"]
    opacity_logit: Float[Tensor, " surfels"]
    sh: Float[Tensor, "surfels coefficients 3"]
    albedo_logit: Float[Tensor, "surfels 3"]
    roughness_logit: Float[Tensor, " surfels"]

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
        """Rotation matrices; columns t_u, t_v, n, in the world. A zero quaternion is no rotation: its frame is zero.

        A zero frame has no tangents, so no camera or ray ever meets that surfel.
        """
        return frames(self.rotation)

    def framed(self) -> "Surfels":
        """The surfels, connected to these, for all that a step asks of their frames: they are computed once."""
        return _Framed(**self.parameters())

    def geometry(self) -> SplatGeometry:
        """The surfels as the tracer meets them."""
        tangent_u, tangent_v, normal = self.frame.unbind(-1)
        scale = self.scale
        axes = tangent_u / scale[:, :1], tangent_v / scale[:, 1:]
        return SplatGeometry(self.centre, *axes, normal.contiguous(), self.opacity)

    def geometry_for(self, camera: Camera) -> SplatGeometry:
        """The surfels as a camera draws them: widened by the footprint of a pixel (``kernels.surfel.footprint``)."""
        return widened(camera, self.centre, self.frame, self.scale, self.opacity)

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

    def made_of(self, albedo: float, roughness: float, opacity: float | None = None) -> "Surfels":
        """A copy of the surfels with a single material; ``opacity`` None keeps their opacity."""
        changes = {
            "albedo_logit": torch.full_like(self.albedo_logit, inverse_sigmoid(albedo)),
            "roughness_logit": torch.full_like(self.roughness_logit, roughness_to_logit(roughness)),
        }
        if opacity is not None:
            changes["opacity_logit"] = torch.full_like(self.opacity_logit, inverse_sigmoid(opacity))
        return replace(self, **changes)

    def held(self, *names: str) -> "Surfels":
        """The surfels, without gradient to the raw tensors of these names: it is neither computed nor stepped on."""
        return replace(self, **{name: getattr(self, name).detach() for name in names})

    def among(self, index: Int[Tensor, " chosen"]) -> "Surfels":
        """The surfels at ``index``, connected to these."""
        return Surfels(**{name: value[index] for name, value in self.parameters().items()})

    def take(self, index: Int[Tensor, " chosen"]) -> "Surfels":
        """The surfels at ``index``, without gradient history."""
        return Surfels(**{name: value.detach()[index] for name, value in self.parameters().items()})


class _Framed(Surfels):
    """Surfels whose rotations stay as they are."""

    @cached_property
    def frame(self) -> Float[Tensor, "surfels 3 3"]:
        return frames(self.rotation)


def surfels_at(
    points: Float[Tensor, "surfels 3"],
    spacing: Float[Tensor, " surfels"],
    seen_from: Float[Tensor, "surfels 3"],
    generator: torch.Generator,
) -> Surfels:
    """Fresh surfels at world ``points``: scale = spacing, opacity 0.1, grey 0.5 radiance, random orientation.

    Their visible side faces ``seen_from``: a surfel that faces away from every camera would never learn to turn.
    Normalised Gaussian quaternions are uniform over rotations (uniform ones in a cube would not be).
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
    """Fresh surfels as ``surfels_at`` makes them, each with a unit normal that is given: turned there from +z the
    shortest way (about x, where that is half a turn)."""
    surfels = surfels_at(points, spacing, points + normals, torch.Generator(points.device).manual_seed(0))
    x, y, z = normals.unbind(-1)
    turn = torch.stack([1 + z, -y, x, torch.zeros_like(z)], -1)
    half = torch.tensor([0.0, 1.0, 0.0, 0.0]).to(turn)
    surfels.rotation = torch.where(turn.norm(dim=-1, keepdim=True) < 1e-3, half, normalize(turn, dim=-1))
    return surfels


def inverse_sigmoid(value: float) -> float:
    """log(p / (1 - p)), for 0 < p < 1."""
    return float(torch.logit(torch.tensor(value, dtype=torch.float64)))


def roughness_to_logit(roughness: float) -> float:
    """The raw parameter of a roughness between ROUGHNESS_FLOOR and 1."""
    return inverse_sigmoid((roughness - ROUGHNESS_FLOOR) / (1 - ROUGHNESS_FLOOR))


def radiance_to_sh(radiance: Float[Tensor, "surfels 3"]) -> Float[Tensor, "surfels 3"]:
    """The degree-0 coefficient of a surfel that sends the same linear radiance everywhere."""
    return (radiance - 0.5) / CONSTANT_BASIS
