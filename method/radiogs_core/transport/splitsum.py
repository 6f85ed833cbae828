"""Split-sum shading: pre-filtered light times a pre-integrated BRDF (paper, initialisation and relighting).

The light is filtered by matrices that keep a constant light constant and the total energy of every other one; they
are linear in the texels, so gradients to the light are exact.
"""

from functools import cache, cached_property

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d

from ..kernels.shade.brdf import smith_visibility
from ..kernels.shade.splitsum import split_sum
from ..scene.light import EnvironmentMap, bilinear_texels, texel_directions, texel_solid_angles

LARGEST_HEIGHT = 32
GRID_HEIGHT = 16
"""Rows of the grid that filtered light is stored on: its content is smooth."""

GRID_SIZE = 2 * GRID_HEIGHT * GRID_HEIGHT
"""Its texels."""

LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Roughnesses of the filtered maps; below the first the light itself (its texels are as wide as that lobe)."""


ENERGY_TOLERANCE = 1e-5
"""Filtering keeps the energy of every texel to this share (16 rounds would leave 1 % at the sharpest level)."""

MOST_BALANCING_ROUNDS = 1024
"""The sharpest level of a light of 16 rows takes longest, about 200; each round is two products with its matrix."""


class PrefilteredLight:
    """A light map, filtered for diffuse and glossy reflection; differentiable in its texels.

    ``radiance``: linear, lat-long (see ``light``). ``sharp``: the same, averaged down by solid angle to at most 32
    rows.
    """

    def __init__(self, radiance: Float[Tensor, "height width 3"]) -> None:
        height = min(radiance.shape[0], LARGEST_HEIGHT)
        area = texel_solid_angles(*radiance.shape[:2]).to(radiance).expand(radiance.shape[:2])
        small = _pooled(radiance * area[..., None], height) / _pooled(area[..., None], height)
        self._matrix = _filters(height).to(radiance)
        self.sharp = small

    @cached_property
    def diffuse(self) -> Float[Tensor, "rows columns 3"]:
        """Irradiance over pi by normal."""
        filtered = self._matrix[:GRID_SIZE] @ self.sharp.reshape(-1, 3)
        return filtered.view(GRID_HEIGHT, 2 * GRID_HEIGHT, 3)

    @cached_property
    def glossy(self) -> Float[Tensor, "levels rows columns 3"]:
        """Light averaged over the GGX lobe of each of LEVELS, by mirrored direction."""
        # Apart from the diffuse one: shading by rays needs that one alone, a sixth of the work.
        filtered = self._matrix[GRID_SIZE:] @ self.sharp.reshape(-1, 3)
        return filtered.view(len(LEVELS), GRID_HEIGHT, 2 * GRID_HEIGHT, 3)

    def irradiance(self, normal: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Unoccluded irradiance over pi: what a white Lambert surface of that normal sends out."""
        return EnvironmentMap(self.diffuse).lookup(normal)


def split_sum_radiance(
    normal: Float[Tensor, "batch 3"],
    albedo: Float[Tensor, "batch 3"],
    roughness: Float[Tensor, " batch"],
    outgoing: Float[Tensor, "batch 3"],
    light: PrefilteredLight,
) -> tuple[Float[Tensor, "batch 3"], Float[Tensor, "batch 3"]]:
    """Diffuse and specular radiance towards unit ``outgoing``, without occlusion; zero seen from behind."""
    table = brdf_table().to(normal)
    both = split_sum(normal, albedo, roughness, outgoing, light.diffuse, light.glossy, light.sharp, table, LEVELS[0])
    return both[:, 0], both[:, 1]


def _pooled(values: Float[Tensor, "height width _"], height: int) -> Float[Tensor, "rows columns _"]:
    return adaptive_avg_pool2d(values.permute(2, 0, 1), (height, 2 * height)).permute(1, 2, 0)


@cache
def brdf_table(size: int = 32, steps: int = 32) -> Float[Tensor, "view roughness 2"]:
    """The integrals on a grid of n.wo by roughness, float32.

    Half-vectors are stratified in the GGX distribution (density D (n.h)); with wi = reflected wo the integrand is
    4 V (wo.h) (n.wi) / (n.h), split into Fresnel's constant and variable parts.
    """
    grid = torch.linspace(0, 1, size, dtype=torch.float64)
    middle = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps
    cosine, roughness = grid[:, None, None, None], grid[None, :, None, None]
    share, azimuth = middle[:, None], 2 * torch.pi * middle[None, :]
    alpha_squared = roughness**4
    half_z = ((1 - share) / (1 + (alpha_squared - 1) * share)).sqrt()
    half_x = (1 - half_z.square()).clamp(min=0).sqrt() * azimuth.cos()
    view_x = (1 - cosine.square()).sqrt()
    view_half = view_x * half_x + cosine * half_z
    light_z = 2 * view_half * half_z - cosine
    valid = (view_half > 0) & (light_z > 0)
    lobe = 4 * smith_visibility(*torch.broadcast_tensors(cosine, light_z.clamp(min=0), roughness))
    value = torch.where(valid, lobe * view_half * light_z / half_z, 0.0)
    bright = torch.exp2((-5.55473 * view_half - 6.98316) * view_half)
    return torch.stack([(value * (1 - bright)).mean((2, 3)), (value * bright).mean((2, 3))], -1).float()


@cache
def _filters(height: int) -> Float[Tensor, "rows texels"]:
    """Rows: the diffuse grid, then the glossy grids; columns: texels of a light of ``height`` rows. Float32.

    The glossy kernel is nvdiffrec's: seen and mirrored along the same axis, weight D(h) (n.wi) per solid angle.
    """
    texels = texel_directions(height, 2 * height).reshape(-1, 3)
    area = texel_solid_angles(height, 2 * height).expand(height, 2 * height).reshape(-1)
    axes = texel_directions(GRID_HEIGHT, 2 * GRID_HEIGHT).reshape(-1, 3)
    cosine = (axes @ texels.T).clamp(-1, 1)
    kernels = [cosine.clamp(min=0)]
    half_cosine_squared = (1 + cosine) / 2
    for roughness in LEVELS:
        alpha_squared = roughness**4
        denominator = half_cosine_squared * (alpha_squared - 1) + 1
        kernels.append(alpha_squared / denominator.square() * cosine.clamp(min=0))
    return torch.cat([_balanced(kernel, area) for kernel in kernels]).float()


def _balanced(kernel: Float[Tensor, "grid texels"], area: Float[Tensor, " texels"]) -> Float[Tensor, "grid texels"]:
    """Scaled so that rows sum to one (a constant stays) and columns give away a texel's light (energy stays).

    In turns, by Sinkhorn: rows alone would brighten a sun near the pole of the map by 7 %.
    """
    covered = _grid_solid_angles()
    rows, columns = torch.ones_like(covered), area
    for _ in range(MOST_BALANCING_ROUNDS):
        before, columns = columns, area / ((covered * rows) @ kernel)
        rows = 1 / (kernel @ columns)
        # What the columns still had to change by is what a texel's energy was off by before this round.
        if float((columns / before - 1).abs().max()) < ENERGY_TOLERANCE:
            break
    return rows[:, None] * kernel * columns


def _grid_solid_angles() -> Float[Tensor, " grid"]:
    """Solid angle that each texel of the grid stands for under bilinear lookup; they add up to the sphere."""
    fine = 64 * GRID_HEIGHT
    direction, width = texel_directions(fine, 4)[:, 0], 2 * GRID_HEIGHT
    texel, share = bilinear_texels(direction, GRID_HEIGHT, width)
    ring = texel_solid_angles(fine, 1) * share / width
    rows = torch.zeros(GRID_HEIGHT, dtype=torch.float64).index_add(0, (texel // width).flatten(), ring.flatten())
    return rows.repeat_interleave(width)
