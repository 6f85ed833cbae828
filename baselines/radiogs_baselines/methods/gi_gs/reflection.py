"""What the points of a frame send towards the camera: the split sum of the light, and a bounce that was gathered."""

import torch
from jaxtyping import Float
from torch import Tensor

from ..split_sum import Reflected, SplitSumLight, normal_reflectance
from .gbuffer import GBuffer


def reflect(buffer: GBuffer, light: SplitSumLight) -> Reflected:
    """The split sum, unoccluded. Gradient to the materials and to the light."""
    return light.reflected(buffer.normal, buffer.outgoing, buffer.albedo, buffer.roughness, buffer.metallic)


def bounce(buffer: GBuffer, gathered: Float[Tensor, "points 3"]) -> Float[Tensor, "points 3"]:
    """Linear diffuse radiance by gathered irradiance over pi: k_D albedo times that; gradient to the albedo alone.

    k_D = (1 - F(n.v)) (1 - metallic), by Schlick's F.
    """
    cosine = (buffer.normal * buffer.outgoing).sum(-1)
    head_on = normal_reflectance(buffer.albedo, buffer.metallic)
    fresnel = head_on + (1 - head_on) * (1 - cosine.clamp(0, 1))[:, None] ** 5
    remaining = (1 - fresnel) * (1 - buffer.metallic)[:, None]
    sent = (remaining * gathered).detach() * buffer.albedo
    return torch.where((cosine > 0)[:, None], sent, 0.0)
