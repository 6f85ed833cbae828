"""Fields with known density and radiance, with factors written by hand; small cameras and runs."""

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from known_ball import CPU, SCENE
from radiogs_baselines.methods.tensoir.box import Box
from radiogs_baselines.methods.tensoir.field import DENSITY_SCALE, DENSITY_SHIFT, UNITS, Field, field_start
from radiogs_baselines.methods.tensoir.light import SphericalGaussians
from radiogs_baselines.methods.tensoir.model import Model
from radiogs_baselines.methods.tensoir.settings import PRESETS, Budget, Variant
from radiogs_core.contract import Run
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

SMOKE = PRESETS["smoke"]
BUDGET = replace(SMOKE, field_iterations=40, inverse_iterations=40)
EMPTY = -100.0
"""Sum of factors at which density is zero in float32."""


def whole_box(cells: int = 4, radius: float = 1.0, dtype: torch.dtype = torch.float32) -> Box:
    """A cube about the origin whose cells are all occupied."""
    return Box(torch.zeros(3, dtype=dtype), radius, torch.ones(cells, cells, cells, dtype=torch.bool))


def random_field(dtype: torch.dtype = torch.float64, seed: int = 0, box: Box | None = None, **budget: Any) -> Field:
    """Random factors as large as those of a learnt field, and random networks."""
    start = field_start(box or whole_box(dtype=dtype), replace(SMOKE, **budget), torch.Generator().manual_seed(seed))
    scaled = {name: value.to(dtype) * (10 if "plane" in name else 5) for name, value in start.parameters.items()}
    return Field(start.box, scaled)


def field_along_z(heights: Tensor, sums: Tensor, box: Box | None = None) -> Field:
    """A field whose sum of factors is ``sums`` at the nodes ``heights`` (all nodes of a regular grid over [-1, 1])."""
    size = len(heights)
    field = random_field(heights.dtype, grid_start=size, box=box or whole_box(dtype=heights.dtype))
    planes = torch.zeros_like(field.parameters["density_plane"])
    lines = torch.zeros_like(field.parameters["density_line"])
    planes[0, :, :, 0] = 1.0
    lines[0, :, 0] = sums
    return Field(field.box, {**field.parameters, "density_plane": planes, "density_line": lines})


def sum_of(density: float) -> float:
    """The sum of factors that gives this density."""
    share = density / (DENSITY_SCALE * UNITS)
    return float(torch.tensor(share, dtype=torch.float64).expm1().log()) - DENSITY_SHIFT


def floor_field(density: float = 300.0, top: float = 0.0, size: int = 65, dtype: torch.dtype = torch.float32) -> Field:
    """A field that is solid up to ``top``, a node of the grid, and empty above."""
    heights = torch.linspace(-1, 1, size, dtype=dtype)
    return field_along_z(heights, torch.where(heights <= top, sum_of(density), EMPTY).to(dtype))


def made_of(field: Field, radiance: float | None = None, albedo: float | None = None, upward: bool = False) -> Field:
    """The field with constant network outputs: radiance, albedo, roughness 0.54, and normals +z."""
    changed = dict(field.parameters)
    for name, value in (("radiance", radiance), ("brdf", albedo)):
        if value is not None:
            changed[f"{name}_weight_2"] = torch.zeros_like(changed[f"{name}_weight_2"])
            bias = torch.zeros_like(changed[f"{name}_bias_2"])
            bias[:3] = torch.logit(torch.tensor(value))
            changed[f"{name}_bias_2"] = bias
    if upward:
        changed["normal_weight_2"] = torch.zeros_like(changed["normal_weight_2"])
        changed["normal_bias_2"] = torch.tensor([0.0, 0.0, 2.0]).to(changed["normal_bias_2"])
    return Field(field.box, changed)


def looking_down(height: float = 0.9, size: int = 3) -> Camera:
    """A camera above the origin whose middle pixel looks straight down."""
    matrix = torch.eye(4)
    matrix[:3, :3] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    matrix[2, 3] = height
    return Camera(matrix, 4.0 * size, 4.0 * size, size / 2, size / 2, size, size)


def grey(radiance: float = 1.0, rows: int = 8) -> EnvironmentMap:
    """A light of constant grey radiance."""
    return EnvironmentMap(torch.full((rows, 2 * rows, 3), radiance))


def constant_light(radiance: float = 1.0, dtype: torch.dtype = torch.float32) -> SphericalGaussians:
    """A light of constant radiance, as one lobe of sharpness zero."""
    return SphericalGaussians(torch.tensor([[0.0, 0.0, 1.0, 0.0, radiance, radiance, radiance]], dtype=dtype))


def run_of(variant: Variant | None = None, budget: Budget = BUDGET) -> Run:
    """A run on the images of a ball."""
    return Run(SCENE, variant or Variant(), budget, 0, CPU)


def model_of(field: Field, radiance: float = 1.0) -> Model:
    """The field with a light of constant radiance."""
    return Model(field, constant_light(radiance))
