"""Filters that blur a light for diffuse and glossy reflection; linear, so that gradients to the light are exact.

Each is a matrix that keeps a constant light constant and the total energy of every other one. A light that is turned
about the vertical gives the filtered light, turned; so the matrix falls apart into one for each frequency along the
azimuth, of the texels at one azimuth (or at the few that a turn of the grid has). For a light of 32 rows that is 1/60
of the time.
"""

from functools import cache
from math import gcd, prod

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from ..scene.light import bilinear_texels, texel_directions, texel_solid_angles

GRID_HEIGHT = 16
"""Rows of the grid that filtered light is stored on: its content is smooth."""

GRID_WIDTH = 2 * GRID_HEIGHT
"""Its columns."""

LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Roughnesses of the glossy filters."""

ENERGY_TOLERANCE = 1e-5
"""Filtering keeps the energy of every texel to this share (16 rounds would leave 1 % at the sharpest level)."""

MOST_BALANCING_ROUNDS = 1024
"""The sharpest level of a light of 16 rows takes longest, about 200; each round is two products with its matrix."""


def turned_spectrum(light: Float[Tensor, "height width channels"]) -> Complex[Tensor, "frequencies texels channels"]:
    """A light by frequency along the azimuth, in double precision: what filters are applied to. ``width``: 2 height."""
    height, width = light.shape[:2]
    turns = _turns(height)
    frequencies = torch.fft.rfft(light.double().unflatten(1, (turns, width // turns)), dim=1)
    return frequencies.transpose(0, 1).flatten(1, 2)


def filtered(
    spectrum: Complex[Tensor, "frequencies texels channels"], height: int, first: int, count: int
) -> Float[Tensor, "{count} rows columns channels"]:
    """The light of ``height`` rows whose ``turned_spectrum`` is given, through ``count`` filters from ``first`` on.

    Filter 0 is diffuse (irradiance over pi by normal); filter k > 0 the average over the GGX lobe of roughness
    LEVELS[k - 1] by mirrored direction. Float64.
    """
    turns = _turns(height)
    columns = GRID_WIDTH // turns
    size = GRID_HEIGHT * columns
    filters = _filters(height, spectrum.device)[:, first * size : (first + count) * size]
    turned = torch.fft.irfft(filters @ spectrum, n=turns, dim=0)
    return turned.unflatten(1, (count, GRID_HEIGHT, columns)).permute(1, 2, 0, 3, 4).flatten(2, 3)


def filters_bytes(height: int) -> int:
    """Bytes of the filters of lights of so many rows."""
    return 16 * prod(_shape(height))


def _turns(height: int) -> int:
    """Turns about the vertical that map both the texels of a light of ``height`` rows and the grid on themselves."""
    return gcd(2 * height, GRID_WIDTH)


def _shape(height: int) -> tuple[int, int, int]:
    """Frequencies, rows of all filters, and texels of a light that are at one azimuth."""
    turns = _turns(height)
    return turns // 2 + 1, (1 + len(LEVELS)) * GRID_HEIGHT * GRID_WIDTH // turns, 2 * height * height // turns


@cache
def _filters(height: int, device: torch.device) -> Complex[Tensor, "frequencies grid texels"]:
    """By frequency: texels of a light to points of the grid, first those of the diffuse filter.

    The glossy kernel is nvdiffrec's: seen and mirrored along the same axis, weight D(h) (n.wi) per solid angle.
    """
    turns = _turns(height)
    columns = 2 * height // turns
    texels = texel_directions(height, 2 * height).view(height, turns, columns, 3).transpose(1, 2).flatten(0, 1)
    axes = texel_directions(GRID_HEIGHT, GRID_WIDTH)[:, : GRID_WIDTH // turns].flatten(0, 1)
    area = texel_solid_angles(height, 2 * height).expand(height, columns).flatten()
    covered = _grid_solid_angles().repeat_interleave(GRID_WIDTH // turns)
    cosine = torch.einsum("ac,btc->abt", axes, texels).clamp(-1, 1)
    kernels = [cosine.clamp(min=0)]
    half_cosine_squared = (1 + cosine) / 2
    for roughness in LEVELS:
        alpha_squared = roughness**4
        denominator = half_cosine_squared * (alpha_squared - 1) + 1
        kernels.append(alpha_squared / denominator.square() * cosine.clamp(min=0))
    balanced = torch.cat([_balanced(kernel, covered, area) for kernel in kernels])
    return torch.fft.rfft(balanced).conj().permute(2, 0, 1).contiguous().resolve_conj().to(device)


def _balanced(
    kernel: Float[Tensor, "grid texels turns"], covered: Float[Tensor, " grid"], area: Float[Tensor, " texels"]
) -> Float[Tensor, "grid texels turns"]:
    """Scaled so that rows sum to one (a constant stays) and columns give away a texel's light (energy stays).

    In turns, by Sinkhorn: rows alone would brighten a sun near the pole of the map by 7 %. ``covered`` and ``area``:
    solid angles of the grid's points and of the texels.
    """
    around = kernel.sum(-1)
    rows, columns = torch.ones_like(covered), area
    for _ in range(MOST_BALANCING_ROUNDS):
        before, columns = columns, area / ((covered * rows) @ around)
        rows = 1 / (around @ columns)
        # What the columns still had to change by is what a texel's energy was off by before this round.
        if float((columns / before - 1).abs().max()) < ENERGY_TOLERANCE:
            break
    return rows[:, None, None] * kernel * columns[:, None]


def _grid_solid_angles() -> Float[Tensor, " rows"]:
    """Solid angle that a point of each row of the grid stands for under bilinear lookup; over all, the sphere."""
    fine = 64 * GRID_HEIGHT
    direction = texel_directions(fine, 4)[:, 0]
    texel, share = bilinear_texels(direction, GRID_HEIGHT, GRID_WIDTH)
    ring = texel_solid_angles(fine, 1) * share / GRID_WIDTH
    return torch.zeros(GRID_HEIGHT, dtype=torch.float64).index_add(0, (texel // GRID_WIDTH).flatten(), ring.flatten())
