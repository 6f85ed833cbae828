"""A frame of GI-GS in float64, written from the formulas as loops over pixels, directions and steps.

Filtered light maps, the table of the BRDF and tangent frames are taken from the product; other tests check them.
"""

import math

import torch
from torch import Tensor

from baselines.methods.dense import encode, seen
from radiogs_baselines.methods.gi_gs.marching import March
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.prefiltered_light import PrefilteredLight, brdf_table
from radiogs_core.transport.sampling import tangent_frame
from reference.shade import environment_radiance

HEIGHTS, AZIMUTHS = 5, 8
"""Size of the grid of directions; directions without weight are marched, too."""

PUBLISHED = sum(math.cos(b * math.pi / 32) * math.sin(b * math.pi / 32) for b in range(17)) * 32 * math.pi / (32 * 17)
"""Irradiance over pi that the published grid of 32 x 17 gathers from a constant radiance of 1."""


def materials(camera: Camera, surfels: Surfels, metallic: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Straight normal, albedo, roughness and metallic of each pixel (columns 0:3, 3:6, 6, 7), alpha, and depth."""
    columns = surfels.albedo, surfels.roughness[:, None], metallic[:, None]
    features, alpha, depth = seen(camera, surfels, *columns)
    whole = torch.where(alpha > 0, alpha, 1.0)
    return features / whole[:, None], alpha, (depth / whole).detach()


def pixels_hit(camera: Camera, marches: March, alpha: Tensor, depth: Tensor, normal: Tensor) -> list[list[int | None]]:
    """Index of the pixel that each direction (azimuths outside, heights inside) of each pixel hits, or None."""
    rays = camera.ray_directions().flatten(0, 1) @ camera.axes
    found = []
    for pixel, ray in enumerate(rays):
        hit_pixels: list[int | None] = []
        frame = tangent_frame((normal[pixel] @ camera.axes)[None])[0]
        position = ray * depth[pixel]
        for phi in (a * 2 * math.pi / AZIMUTHS for a in range(AZIMUTHS)):
            for theta in (b * math.pi / 2 / (HEIGHTS - 1) for b in range(HEIGHTS)):
                local = [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]
                along = frame @ torch.tensor(local, dtype=normal.dtype)
                hit_pixels.append(_march(camera, marches, alpha, depth, position, along) if alpha[pixel] > 0 else None)
        found.append(hit_pixels)
    return found


def _march(camera: Camera, marches: March, alpha: Tensor, depth: Tensor, position: Tensor, along: Tensor) -> int | None:
    for share in marches.distances:
        x, y, z = (position + along * share * marches.radius * (1 + position[2] / marches.far) ** 2).tolist()
        if z <= 0:
            return None
        column, row = math.floor(camera.fx * x / z + camera.cx), math.floor(camera.fy * y / z + camera.cy)
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            return None
        pixel = row * camera.width + column
        surface = float(depth[pixel])
        if alpha[pixel] >= 0.5 and z - marches.thick <= surface <= z + marches.bias:
            return pixel
    return None


def image(
    camera: Camera,
    marches: March,
    surfels: Surfels,
    metallic: Tensor,
    radiance: Tensor,
    hit_pixels: list[list[int | None]],
) -> Tensor:
    """Display image [pixels, 3], not clipped: sRGB(direct) + sRGB(median(bounce)), both multiplied by alpha.

    Hits, the radiance that hit pixels send, occlusion, Fresnel's factor, normals and depth have no gradient.
    """
    straight, alpha, _ = materials(camera, surfels, metallic)
    direct, diffuse_share = [], []
    light, table = PrefilteredLight(radiance), brdf_table().double()
    weight = [
        math.cos(b * math.pi / 2 / (HEIGHTS - 1)) * math.sin(b * math.pi / 2 / (HEIGHTS - 1))
        for _ in range(AZIMUTHS)
        for b in range(HEIGHTS)
    ]
    rays = camera.ray_directions().flatten(0, 1)
    for pixel, (values, hits) in enumerate(zip(straight, hit_pixels, strict=True)):
        normal = (values[:3] / values[:3].norm()).detach()
        outgoing = -rays[pixel] / rays[pixel].norm()
        cosine = float(normal @ outgoing)
        open_share = 1 - sum(w for w, hit in zip(weight, hits, strict=True) if hit is not None) / sum(weight)
        albedo, roughness, metal = values[3:6], values[6], values[7]
        reflectance = 0.04 * (1 - metal) + albedo * metal
        diffuse = albedo * environment_radiance(light.diffuse, normal)
        lobe = _lobe(light, 2 * cosine * normal - outgoing, roughness)
        a, b = _table(table, cosine, roughness)
        direct.append(open_share * diffuse + lobe * (reflectance * a + b))
        fresnel = reflectance + (1 - reflectance) * (1 - cosine) ** 5
        diffuse_share.append(((1 - fresnel) * (1 - metal)).detach())
    sent = [values.detach().clamp(0, 1) for values in direct]
    bounced = []
    for pixel, hits in enumerate(hit_pixels):
        gathered = torch.zeros(3, dtype=alpha.dtype)
        for w, hit in zip(weight, hits, strict=True):
            if hit is not None:
                gathered = gathered + PUBLISHED * w / sum(weight) * sent[hit]
        bounced.append(diffuse_share[pixel] * straight[pixel, 3:6] * gathered)
    smooth = _median(encode(torch.stack(bounced)), camera)
    return (encode(torch.stack(direct)) + smooth) * alpha[:, None]


def _lobe(light: PrefilteredLight, mirrored: Tensor, roughness: Tensor) -> Tensor:
    """Linear interpolation between the light itself at roughness 0 and the lobes of 0.2, 0.4, 0.6, 0.8 and 1."""
    maps = [environment_radiance(map_, mirrored) for map_ in (light.sharp, *light.both[1])]
    lower = min(int(float(roughness.detach()) / 0.2), 4)
    share = roughness / 0.2 - lower
    return (1 - share) * maps[lower] + share * maps[lower + 1]


def _table(table: Tensor, cosine: float, roughness: Tensor) -> tuple[Tensor, Tensor]:
    size = len(table) - 1
    row, column = int(cosine * size), int(float(roughness.detach()) * size)
    down, right = cosine * size - row, roughness * size - column
    upper = (1 - right) * table[row, column] + right * table[row, column + 1]
    lower = (1 - right) * table[row + 1, column] + right * table[row + 1, column + 1]
    a, b = ((1 - down) * upper + down * lower).unbind()
    return a, b


def _median(values: Tensor, camera: Camera) -> Tensor:
    """The fifth of the nine sorted values around each pixel; values beyond the border are zero."""
    grid = values.view(camera.height, camera.width, 3)
    rows = []
    for row in range(camera.height):
        for column in range(camera.width):
            around = [
                grid[i, j] if 0 <= i < camera.height and 0 <= j < camera.width else torch.zeros(3, dtype=grid.dtype)
                for i in range(row - 1, row + 2)
                for j in range(column - 1, column + 2)
            ]
            rows.append(torch.stack(around).sort(0).values[4])
    return torch.stack(rows)
