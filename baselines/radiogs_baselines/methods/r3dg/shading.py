"""Forward shading: every surfel is shaded towards the camera, and what it sends out is blended."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.shade.shade import shade
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.splatting import (
    DIFFUSE_DIRECT,
    DIFFUSE_INDIRECT,
    SPECULAR_DIRECT,
    SPECULAR_INDIRECT,
    Splat,
    splat,
    towards,
)


@dataclass(frozen=True)
class Lit:
    """Light on every surfel, linear. radiance: sent towards the camera, zero where it looks from behind.

    irradiance: E = sum_i w_i L_i (n.w_i), of all surfels.
    """

    radiance: Float[Tensor, "surfels 3"]
    irradiance: Float[Tensor, "surfels 3"]


def light_surfels(
    camera: Camera, surfels: Surfels, incident: Incident, environment: Float[Tensor, "rows columns 3"]
) -> Lit:
    """L_o = sum_i w_i (a / pi + f_s) L_i (n.w_i) with L_i = V L_env + L_local, in one pass of the kernel.

    It shades white surfels, so that the irradiance is seen; those that face away, along their normals and without lobe.
    """
    normal, outgoing = surfels.frame[..., 2], towards(camera, surfels)
    facing = (normal * outgoing).sum(-1) > 0
    white = torch.ones_like(surfels.albedo)
    parts = shade(
        normal, white, surfels.roughness, torch.where(facing[:, None], outgoing, normal)[:, None],
        incident.direction, incident.weight, incident.visibility, incident.radiance, environment, facing,
    )[:, 0]  # fmt: skip
    diffuse = parts[:, DIFFUSE_DIRECT] + parts[:, DIFFUSE_INDIRECT]
    specular = parts[:, SPECULAR_DIRECT] + parts[:, SPECULAR_INDIRECT]
    radiance = torch.where(facing[:, None], surfels.albedo * diffuse + specular, 0.0)
    return Lit(radiance, torch.pi * diffuse)


def blended(camera: Camera, surfels: Surfels, lit: Lit, depth_unit: float = 1.0) -> Splat:
    """The maps ``radiance``, ``irradiance``, ``albedo`` and ``roughness``, all multiplied by coverage."""
    channels = {
        "radiance": lit.radiance,
        "irradiance": lit.irradiance,
        "albedo": surfels.albedo,
        "roughness": surfels.roughness[:, None],
    }
    return splat(camera, surfels, channels, depth_unit)
