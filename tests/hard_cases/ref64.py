"""From raw parameters to images in plain float64, sharing no code with the method: the judge of the hard cases.

Inputs are widened to float64 as they were rounded to float32, so that what differs is arithmetic and not quantisation.
"""

import math
from typing import Any

import torch
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from reference.rasterize import rasterize
from reference.trace import harmonics, trace

EPS = float(torch.finfo(torch.float32).eps)


def rotations(quaternion: Tensor) -> Tensor:
    """Rodrigues' formula I + 2 w [v] + 2 [v]^2 for the unit quaternions (w, v) along ``quaternion`` [n, 4]."""
    unit = quaternion.double() / quaternion.double().norm(dim=-1, keepdim=True)
    w, vector = unit[:, :1, None], unit[:, 1:]
    cross = torch.linalg.cross(
        torch.eye(3, dtype=torch.float64).expand(len(vector), 3, 3), vector[:, None].expand(-1, 3, 3), dim=-1
    )
    return torch.eye(3, dtype=torch.float64) + 2 * w * cross + 2 * cross @ cross


def splats(surfels: Surfels, camera: Camera | None = None) -> dict[str, Tensor]:
    """The surfels as a ray hits them (or, with a camera, widened by the footprint of its pixels)."""
    turned = rotations(surfels.rotation)
    scale = surfels.log_scale.double().exp()
    opacity = 1 / (1 + torch.exp(-surfels.opacity_logit.double()))
    to_plane = torch.diag_embed(1 / scale)
    if camera is not None:
        offset = surfels.centre.double() - camera.centre.double()
        pixel = (offset @ camera.axes[:, 2].double()).abs() / ((camera.fx + camera.fy) / 2)
        view = offset / offset.norm(dim=-1, keepdim=True)
        across = (turned[..., :2] * view[..., None]).sum(1)
        cosine = (turned[..., 2] * view).sum(-1).abs().clamp(min=0.05)
        stretched = torch.eye(2).double() + across[:, :, None] * across[:, None] / cosine[:, None, None] ** 2
        covariance = torch.diag_embed(scale**2) + pixel[:, None, None] ** 2 / 12 * stretched
        to_plane = torch.linalg.inv(torch.linalg.cholesky(covariance))
        opacity = opacity * scale.prod(-1) / torch.linalg.det(covariance).sqrt()
    axes = turned[..., :2] @ to_plane.mT
    return {
        "centre": surfels.centre.double(),
        "axis_u": axes[..., 0],
        "axis_v": axes[..., 1],
        "normal": turned[..., 2],
        "opacity": opacity,
    }


def image(camera: Camera, geometry: dict[str, Tensor], features: Tensor, depth_unit: float = 1.0) -> tuple[Tensor, ...]:
    """Features, alpha, depth and distortion of every pixel."""
    view = camera.to(dtype=torch.float64)
    pixels = view.ray_directions().reshape(-1, 3)
    given = [geometry[name].double() for name in ("centre", "axis_u", "axis_v", "normal", "opacity")]
    flat = rasterize(view.axes, view.centre, pixels, *given, features.double(), depth_unit)
    return tuple(value.unflatten(0, (view.height, view.width)) for value in flat)


def colours(surfels: Surfels, camera: Camera) -> Tensor:
    """Radiance towards the camera and the roughness, [n, 4]."""
    towards = surfels.centre.double() - camera.centre.double()
    length = towards.norm(dim=-1, keepdim=True)
    direction = towards / torch.where(length > 0, length, 1.0)
    radiance = (torch.einsum("nk,nkc->nc", harmonics(direction), surfels.sh.double()) + 0.5).clamp(min=0)
    roughness = 0.05 + 0.95 / (1 + torch.exp(-surfels.roughness_logit.double()))
    return torch.cat([radiance, roughness[:, None]], -1)


def traced(geometry: dict[str, Tensor], rays: dict[str, Tensor], stop: float = 0.03) -> tuple[Tensor, ...]:
    """Radiance, transmittance, features, depth of every ray; ``rays`` hold sh, features, origin, direction, t_min."""
    given: dict[str, Any] = {name: value.double() for name, value in {**geometry, **rays}.items()}
    return trace(**given, stop=stop)


def cast(given: dict[str, Tensor], rays: dict[str, Tensor], stop: float = 0.03) -> tuple[Tensor, ...]:
    """``traced`` of surfels that hold everything, as ``constructions.cast`` takes them."""
    geometry = {name: given[name] for name in ("centre", "axis_u", "axis_v", "normal", "opacity")}
    return traced(geometry, {"sh": given["sh"], "features": given["features"]} | rays, stop)


def ggx(half_angle: Tensor, roughness: float) -> Tensor:
    """D of an angle between normal and half-vector: alpha^2 / (pi (alpha^2 cos^2 + sin^2)^2), per steradian."""
    alpha_squared = roughness**4
    angle = half_angle.double()
    return alpha_squared / (math.pi * (alpha_squared * angle.cos() ** 2 + angle.sin() ** 2) ** 2)
