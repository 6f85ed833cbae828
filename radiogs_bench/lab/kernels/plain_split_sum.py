"""The yardstick of split-sum shading as PyTorch expressions; tests compare the kernel with it too."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.shade.brdf import FRESNEL_NORMAL
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.light_filters import LEVELS
from radiogs_core.transport.splitsum import PrefilteredLight, brdf_table


def split_sum_radiance(
    normal: Float[Tensor, "points 3"],
    albedo: Float[Tensor, "points 3"],
    roughness: Float[Tensor, " points"],
    outgoing: Float[Tensor, "points 3"],
    light: PrefilteredLight,
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Diffuse and specular radiance towards unit ``outgoing``; zero seen from behind."""
    cosine = (normal * outgoing).sum(-1)
    front = (cosine > 0)[:, None]
    mirrored = 2 * cosine[:, None] * normal - outgoing
    scale, bias = brdf_integral(cosine.clamp(0, 1), roughness)
    reflectance = (FRESNEL_NORMAL * scale + bias)[:, None]
    return (
        torch.where(front, albedo * light.irradiance(normal), 0.0),
        torch.where(front, reflectance * glossy(light, mirrored, roughness), 0.0),
    )


def glossy(
    light: PrefilteredLight, direction: Float[Tensor, "points 3"], roughness: Float[Tensor, " points"]
) -> Float[Tensor, "points 3"]:
    """Light averaged over the lobe about a mirror direction; all levels are read, and two are blended."""
    place = (roughness / LEVELS[0]).clamp(0, len(LEVELS))
    maps = torch.stack([EnvironmentMap(map_).lookup(direction) for map_ in (light.sharp, *light.glossy)])
    lower = place.detach().floor().clamp(max=len(LEVELS) - 1).long()
    each = torch.arange(len(direction), device=direction.device)
    return torch.lerp(maps[lower, each], maps[lower + 1, each], (place - lower)[:, None])


def brdf_integral(
    cosine: Float[Tensor, " points"], roughness: Float[Tensor, " points"]
) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"]]:
    """A and B with F0 A + B = integral of f_s (n.wi) over the hemisphere; cosine n.wo in [0, 1]."""
    table = brdf_table().to(cosine)
    size = table.shape[0]
    row, column = cosine * (size - 1), roughness * (size - 1)
    top, left = (place.detach().floor().clamp(0, size - 2) for place in (row, column))
    i, j = top.long(), left.long()
    down, right = (row - top)[:, None], (column - left)[:, None]
    upper = torch.lerp(table[i, j], table[i, j + 1], right)
    lower = torch.lerp(table[i + 1, j], table[i + 1, j + 1], right)
    return torch.lerp(upper, lower, down).unbind(-1)  # type: ignore[return-value]
