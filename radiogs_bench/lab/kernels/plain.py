"""Yardsticks of the kernels: their sums as plain PyTorch expressions, with autograd; tests compare with them too."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.shade.brdf import FRESNEL_NORMAL, diffuse, specular
from radiogs_core.kernels.surfel.geometry import ALPHA_THRESHOLD, MAX_ALPHA, SplatGeometry
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import CONSTANT_BASIS
from radiogs_core.transport.light_filters import LEVELS
from radiogs_core.transport.prefiltered_light import Masking, PrefilteredLight, brdf_table

PIXELS_AT_ONCE = 1024
"""Pixels that are processed together, against all surfels."""


def rasterize_densely(
    camera: Camera, geometry: SplatGeometry, features: Float[Tensor, "surfels channels"]
) -> Float[Tensor, "pixels channels"]:
    """Every pixel against every surfel, front to back; without the early stop at opaque pixels."""
    order = (geometry.centre @ camera.axes[:, 2]).argsort(stable=True)
    centre, axis_u, axis_v, normal, opacity, feature = (
        value[order]
        for value in (
            geometry.centre, geometry.axis_u, geometry.axis_v, geometry.normal, geometry.opacity, features,
        )
    )  # fmt: skip
    towards = centre - camera.centre
    rows = []
    for ray in camera.ray_directions().flatten(0, 1).split(PIXELS_AT_ONCE):
        slope = ray @ normal.T
        depth = (normal * towards).sum(-1) / torch.where(slope < 0, slope, -1.0)
        u = depth * (ray @ axis_u.T) - (axis_u * towards).sum(-1)
        v = depth * (ray @ axis_v.T) - (axis_v * towards).sum(-1)
        alpha = opacity * (-0.5 * (u * u + v * v)).exp()
        met = (slope < 0) & (depth > 0) & (alpha >= ALPHA_THRESHOLD)
        alpha = torch.where(met, alpha.clamp(max=MAX_ALPHA), 0.0)
        left = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1 - alpha[:, :-1]], 1), 1)
        rows.append((left * alpha) @ feature)
    return torch.cat(rows)


def shade_plainly(
    normal: Float[Tensor, "surfels 3"],
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    outgoing: Float[Tensor, "surfels views 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    visibility: Float[Tensor, "surfels samples"],
    indirect: Float[Tensor, "surfels samples 3"],
    environment: Float[Tensor, "height width 3"],
) -> Float[Tensor, "surfels views 4 3"]:
    """Eq. 8 written out: every factor for all surfels, views and samples, then a sum (see ``kernels.shade``)."""
    n, wo, wi = torch.broadcast_tensors(normal[:, None, None], outgoing[:, :, None], direction[:, None])
    cosine = (n * wi).sum(-1)
    above = ((n * wo).sum(-1, keepdim=True) > 0) & (cosine > 0)[..., None]
    glossy = torch.where(above, specular(n, wo, wi, roughness[:, None, None].expand_as(cosine))[..., None], 0.0)
    matt = torch.where(above, diffuse(albedo[:, None, None]), 0.0)
    direct = (visibility[..., None] * EnvironmentMap(environment).lookup(direction))[:, None]
    weighted = (weight[:, None] * cosine.clamp(min=0))[..., None]
    parts = (matt * direct, matt * indirect[:, None], glossy * direct, glossy * indirect[:, None])
    return torch.stack([(weighted * part).sum(2) for part in parts], 2)


def harmonics_plainly(
    sh: Float[Tensor, "surfels coefficients 3"], direction: Float[Tensor, "surfels views 3"]
) -> Float[Tensor, "surfels views 3"]:
    """The sum over basis functions by a product and a sum: faster than thousands of 1 x 16 by 16 x 3 matrices."""
    values = basis(direction)[..., : sh.shape[1]]
    return (values[..., None] * sh[:, None]).sum(-2)


def basis(direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 16"]:
    """The 16 basis functions at unit directions of travel (from the viewer to the surfel)."""
    x, y, z = direction.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    return torch.stack(
        [
            torch.full_like(x, CONSTANT_BASIS),
            -0.4886025119029199 * y,
            0.4886025119029199 * z,
            -0.4886025119029199 * x,
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ],
        -1,
    )


def split_sum_plainly(
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
    scale, bias = brdf_integral(cosine.clamp(0, 1), roughness, light.masking)
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
    maps = torch.stack([EnvironmentMap(map_).lookup(direction) for map_ in (light.sharp, *light.both[1])])
    lower = place.detach().floor().clamp(max=len(LEVELS) - 1).long()
    each = torch.arange(len(direction), device=direction.device)
    return torch.lerp(maps[lower, each], maps[lower + 1, each], (place - lower)[:, None])


def brdf_integral(
    cosine: Float[Tensor, " points"], roughness: Float[Tensor, " points"], masking: Masking = "schlick"
) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"]]:
    """A and B with F0 A + B = integral of f_s (n.wi) over the hemisphere; cosine n.wo in [0, 1]."""
    table = brdf_table(masking).to(cosine)
    size = table.shape[0]
    row, column = cosine * (size - 1), roughness * (size - 1)
    top, left = (place.detach().floor().clamp(0, size - 2) for place in (row, column))
    i, j = top.long(), left.long()
    down, right = (row - top)[:, None], (column - left)[:, None]
    upper = torch.lerp(table[i, j], table[i, j + 1], right)
    lower = torch.lerp(table[i + 1, j], table[i + 1, j + 1], right)
    return torch.lerp(upper, lower, down).unbind(-1)  # type: ignore[return-value]
