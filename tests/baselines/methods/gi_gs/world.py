"""Depth maps in closed form, and floors with a block of tiles, for tests of GI-GS's marches."""

import math
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from baselines.methods.irgs.world import UP, looking_down, sheet
from radiogs_baselines.methods.gi_gs.gbuffer import GBuffer, gbuffer, seen_materials
from radiogs_baselines.methods.gi_gs.marching import Grid, March
from radiogs_baselines.methods.gi_gs.settings import PRESETS, Sum
from radiogs_baselines.methods.gi_gs.shading import Shader
from radiogs_baselines.methods.gi_gs.showing import Renderer
from radiogs_baselines.methods.gs_ir.metallic import MetallicSurfels
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.prefiltered_light import PrefilteredLight

SMOKE = PRESETS["smoke"]
SIZE = 21
MIDDLE = SIZE // 2
EDGE = MIDDLE + 1
"""First column of the wall, directly beside the middle pixel."""

DISTANCE = 10.0
"""Depth of the floor; its pixels are 0.1 wide."""

FINE = 141
"""Pixels along the side of a frame whose pixels are 0.01 wide: no march of a grid stays within one pixel."""


def march(
    distances: tuple[float, ...] = (0.5, 0.75),
    azimuths: int = 8,
    heights: int = 5,
    bias: float = 0.01,
    thick: float = 0.5,
) -> March:
    """Marches of radius 0.8, nearly independent of depth."""
    return March(Grid.of(azimuths, heights), distances, 0.8, bias, thick, 1e9)


def frame(depth: Tensor, albedo: float = 0.5, middle: int | None = None, focal: float = 100.0) -> GBuffer:
    """G-buffer of a depth map; the camera's axes are the world's, and every normal faces the camera.

    ``middle``: row, and equal column, of the only point; None: all pixels are points.
    """
    height, width = depth.shape
    camera = Camera(torch.eye(4, dtype=depth.dtype), focal, focal, height / 2, height / 2, width, height)
    pixel = torch.arange(depth.numel()) if middle is None else torch.tensor([middle * width + middle])
    rays = camera.ray_directions().flatten(0, 1)[pixel]
    ones = torch.ones(len(pixel), dtype=depth.dtype)
    return GBuffer(
        camera=camera,
        pixel=pixel,
        position=rays * depth.flatten()[pixel, None],
        normal=torch.tensor([0.0, 0.0, -1.0], dtype=depth.dtype).expand(len(pixel), 3),
        outgoing=-rays / rays.norm(dim=-1, keepdim=True),
        albedo=albedo * ones[:, None].expand(-1, 3),
        roughness=0.9 * ones,
        metallic=0 * ones,
        depth=depth,
    )


def beside_a_wall(height: float, dtype: torch.dtype = torch.float32, albedo: float = 0.5) -> GBuffer:
    """A floor seen from above, with a block of that height from column ``EDGE`` on."""
    depth = torch.full((SIZE, SIZE), DISTANCE, dtype=dtype)
    depth[:, EDGE:] -= height
    return frame(depth, albedo)


def only_beside_a_wall(height: float, columns: int = FINE) -> GBuffer:
    """``beside_a_wall`` with fine pixels, in float64, and with its middle pixel as the only point."""
    depth = torch.full((FINE, columns), DISTANCE, dtype=torch.float64)
    depth[:, FINE // 2 + 1 :] -= height
    return frame(depth, middle=FINE // 2, focal=1000.0)


def of_middle(values: Tensor, buffer: GBuffer) -> Tensor:
    """The row of the middle pixel, or of the only point."""
    return values[len(buffer) // 2]


def shader(
    occlusion: bool = True, indirect: bool = True, where: Sum = "display", marches: March | None = None
) -> Shader:
    """The shader of the full method, with these switches."""
    return Shader(marches or march(), occlusion, indirect, where, True)


def light_of(radiance: float | Tensor, rows: int = 8, dtype: torch.dtype = torch.float32) -> SplitSumLight:
    """A split-sum light of constant radiance."""
    return SplitSumLight(PrefilteredLight(torch.as_tensor(radiance, dtype=dtype).expand(rows, 2 * rows, 3)))


def shown(surfels: Surfels, camera: Camera, light: SplitSumLight, how: Shader | None = None) -> dict[str, Tensor]:
    """All maps of a view."""
    model = unlit(surfels)
    return Renderer(model, surfels.albedo, light, how or shader()).render(camera)


def unlit(surfels: Surfels, metallic_logit: Tensor | None = None) -> MetallicSurfels:
    """A model whose own light is not read."""
    return MetallicSurfels(surfels, torch.zeros(4, 8, 3, dtype=surfels.centre.dtype), metallic_logit)


def buffer_of(camera: Camera, surfels: Surfels, metallic_logit: Tensor | None = None) -> tuple[GBuffer, Tensor]:
    """G-buffer of a camera's frame, and its coverage."""
    seen = seen_materials(camera, unlit(surfels, metallic_logit), surfels.albedo)
    return gbuffer(camera, seen), seen.alpha


def block(height: float, left: float, right: float, spacing: float = 0.05, **given: Any) -> Surfels:
    """Tiles at that height, over ``left`` to ``right`` along x and 1 to either side along y."""
    x = torch.arange(left, right, spacing)
    y = torch.arange(-1.0, 1.0, spacing)
    x, y = (values.flatten() for values in torch.meshgrid(x, y, indexing="ij"))
    tile = sheet(height, UP, **{"scale": spacing / 2, **given})
    tiles = {name: value.expand(len(x), *value.shape[1:]).contiguous() for name, value in tile.parameters().items()}
    return Surfels.of(tiles | {"centre": torch.stack([x, y, torch.full_like(x, height)], -1)})


def cropped(camera: Camera, columns: int) -> Camera:
    """The camera with a frame of only the first columns."""
    return replace(camera, width=columns)


def above(height: float = 3.0, size: int = 31) -> Camera:
    """A camera that looks straight down; its middle pixel sees the origin."""
    return looking_down(height, size)


def share_towards(azimuths: int) -> float:
    """Share of the grid's weight in directions whose azimuth points to +x, in closed form."""
    turning = [math.cos(2 * math.pi * index / azimuths) > 1e-9 for index in range(azimuths)]
    return sum(turning) / azimuths
