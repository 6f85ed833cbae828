"""What the points of a frame send towards the camera: the split sum of the light, and a bounce that was gathered."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.shade.brdf import FRESNEL_NORMAL
from radiogs_core.transport.splitsum import brdf_table

from .gbuffer import GBuffer
from .lighting import SplitSumLight


@dataclass(frozen=True)
class Reflected:
    """Linear radiance towards the camera by unoccluded light from afar; zero where a point is seen from behind."""

    diffuse: Float[Tensor, "points 3"]
    specular: Float[Tensor, "points 3"]

    def occluded(self, occlusion: Float[Tensor, " points"]) -> Float[Tensor, "points 3"]:
        """Their sum, where a share ``occlusion`` of the light reaches the point; lobes are never occluded."""
        return self.diffuse * occlusion[:, None] + self.specular


def reflect(buffer: GBuffer, light: SplitSumLight) -> Reflected:
    """The split sum: albedo E(n), and S(r, roughness) (F0 A + B). Gradient to the materials and to the light."""
    cosine = _cosine(buffer)
    front = (cosine > 0)[:, None]
    mirrored = 2 * cosine[:, None] * buffer.normal - buffer.outgoing
    scale, bias = _brdf_integral(cosine.clamp(0, 1), buffer.roughness)
    lobe = _normal_reflectance(buffer) * scale[:, None] + bias[:, None]
    return Reflected(
        torch.where(front, buffer.albedo * light.irradiance(buffer.normal), 0.0),
        torch.where(front, lobe * light.glossy(mirrored, buffer.roughness), 0.0),
    )


def bounce(buffer: GBuffer, gathered: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
    """Linear diffuse radiance by gathered irradiance over pi: k_D albedo times that; gradient to the albedo alone.

    k_D = (1 - F(n.v)) (1 - metallic), by Schlick's F.
    """
    cosine, normal_reflectance = _cosine(buffer), _normal_reflectance(buffer)
    fresnel = normal_reflectance + (1 - normal_reflectance) * (1 - cosine.clamp(0, 1))[:, None] ** 5
    remaining = (1 - fresnel) * (1 - buffer.metallic)[:, None]
    sent = (remaining * gathered).detach() * buffer.albedo
    return torch.where((cosine > 0)[:, None], sent, 0.0)


def _cosine(buffer: GBuffer) -> Float[Tensor, " points"]:
    return (buffer.normal * buffer.outgoing).sum(-1)


def _normal_reflectance(buffer: GBuffer) -> Float[Tensor, "points 3"]:
    metallic = buffer.metallic[:, None]
    return FRESNEL_NORMAL * (1 - metallic) + buffer.albedo * metallic


def _brdf_integral(
    cosine: Float[Tensor, " points"], roughness: Float[Tensor, " points"]
) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"]]:
    """A and B with F0 A + B = integral of f_s (n.wi) over the hemisphere; bilinear in n.wo and roughness."""
    table = brdf_table().to(cosine)
    size = len(table)
    row, column = cosine * (size - 1), roughness * (size - 1)
    top, left = (place.detach().floor().clamp(0, size - 2) for place in (row, column))
    i, j = top.long(), left.long()
    down, right = (row - top)[:, None], (column - left)[:, None]
    upper = torch.lerp(table[i, j], table[i, j + 1], right)
    lower = torch.lerp(table[i + 1, j], table[i + 1, j + 1], right)
    both = torch.lerp(upper, lower, down)
    return both[:, 0], both[:, 1]
