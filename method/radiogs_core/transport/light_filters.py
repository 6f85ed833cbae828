"""Linear filters of a light map for diffuse and glossy reflection; gradients to the light are exact.

Each filter is a matrix that keeps a constant light constant and preserves the total energy of any light. Filtering
commutes with rotations about the vertical, so a Fourier transform along the azimuth splits the matrix into one block
for each frequency, over the texels within one rotation step. For a light of 32 rows this takes 1/60 of the time.
"""

from functools import cache
from math import gcd
from typing import Any

import torch
from jaxtyping import Complex, Float
from torch import Tensor

from ..scene.light import bilinear_texels, texel_directions, texel_solid_angles

GRID_HEIGHT = 16
"""Rows of the grid on which filtered light is stored; filtered light is smooth."""

GRID_WIDTH = 2 * GRID_HEIGHT
"""Columns of this grid."""

LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""Perceptual roughness of each glossy filter."""

ENERGY_TOLERANCE = 1e-5
"""Largest relative error of the energy of a texel after filtering (16 rounds would leave 1 % at the sharpest level)."""

MOST_BALANCING_ROUNDS = 1024
"""Largest number of balancing rounds, each two products with the filter's matrix. The sharpest level of a light of 16
rows needs most, about 200."""


def turned_spectrum(light: Float[Tensor, "height width channels"]) -> Complex[Tensor, "frequencies texels channels"]:
    """Fourier transform of a light along the azimuth, the input of ``filtered``; complex128. ``width`` is 2 height."""
    height, width = light.shape[:2]
    turns = _turns(height)
    frequencies = torch.fft.rfft(light.double().unflatten(1, (turns, width // turns)), dim=1)
    # Small matrices are multiplied three times as fast if they have no gaps.
    return frequencies.transpose(0, 1).contiguous().flatten(1, 2)


def filtered(
    spectrum: Complex[Tensor, "frequencies texels channels"], height: int, first: int, count: int
) -> Float[Tensor, "{count} rows columns channels"]:
    """Apply ``count`` filters, from number ``first`` on, to the ``turned_spectrum`` of a light of ``height`` rows.

    Filter 0 is diffuse: irradiance over pi, indexed by the normal. Filter k > 0 is the average over the GGX lobe of
    roughness LEVELS[k - 1], indexed by the mirrored view direction. Returns maps of GRID_HEIGHT x GRID_WIDTH, float64.
    """
    turns = _turns(height)
    columns = GRID_WIDTH // turns
    turned = torch.fft.irfft(_some(height, first, count, spectrum.device).bmm(spectrum), n=turns, dim=0)
    return turned.unflatten(1, (count, GRID_HEIGHT, columns)).permute(1, 2, 0, 3, 4).flatten(2, 3)


def filtered_light(
    light: Float[Tensor, "height width channels"], count: int
) -> Float[Tensor, "{count} rows columns channels"]:
    """The first ``count`` filters (see ``filtered``) of a light, in its type. ``width`` is 2 height."""
    return _Filtered.apply(light, count)


class _Filtered(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, light: Tensor, count: int) -> Tensor:
        ctx.height = len(light)
        return filtered(turned_spectrum(light), len(light), 0, count).to(light.dtype)

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None]:
        # The factors by which the adjoints of both Fourier transforms differ from their inverses cancel.
        turns = _turns(ctx.height)
        columns = GRID_WIDTH // turns
        spectrum = torch.fft.rfft(pull.double().unflatten(2, (turns, columns)), dim=2)
        along = spectrum.permute(2, 0, 1, 3, 4).contiguous().flatten(1, 3)
        turned = torch.fft.irfft(_adjoint(ctx.height, len(pull), pull.device).bmm(along), n=turns, dim=0)
        return turned.unflatten(1, (ctx.height, -1)).transpose(0, 1).flatten(1, 2).to(pull.dtype), None


def _some(height: int, first: int, count: int, device: torch.device) -> Complex[Tensor, "frequencies grid texels"]:
    """The matrices of ``count`` filters, from number ``first`` on."""
    size = GRID_HEIGHT * GRID_WIDTH // _turns(height)
    return filter_matrices(height, device)[:, first * size : (first + count) * size]


@cache
def _adjoint(height: int, count: int, device: torch.device) -> Complex[Tensor, "frequencies texels grid"]:
    """The conjugate transposes of the first ``count`` filters' matrices."""
    return _some(height, 0, count, device).mH.contiguous().resolve_conj()


def _turns(height: int) -> int:
    """Number of rotations about the vertical that map both the texels of a light of ``height`` rows and the grid onto
    themselves."""
    return gcd(2 * height, GRID_WIDTH)


@cache
def filter_matrices(height: int, device: torch.device) -> Complex[Tensor, "frequencies grid texels"]:
    """For each frequency, the matrix from texels of a light to points of the grid: first the diffuse filter's points,
    then each glossy filter's.

    The glossy kernel is nvdiffrec's: view and normal along the mirrored direction, weight D(h) (n.wi) per solid angle.
    """
    turns = _turns(height)
    columns = 2 * height // turns
    texels = texel_directions(height, 2 * height).view(height, turns, columns, 3).transpose(1, 2).flatten(0, 1)
    axes = texel_directions(GRID_HEIGHT, GRID_WIDTH)[:, : GRID_WIDTH // turns].flatten(0, 1)
    area = texel_solid_angles(height, 2 * height).expand(height, columns).flatten()
    covered = grid_solid_angles().repeat_interleave(GRID_WIDTH // turns)
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
    """The kernel with rows and columns scaled alternately (Sinkhorn).

    Rows then sum to one, so a constant light stays constant, and columns distribute exactly the energy of their texel.
    Scaling the rows only would brighten a sun near the pole of the map by 7 %.

    Args:
        kernel: Weight of each texel at each grid point, for all rotations.
        covered: Solid angles of the grid's points, steradian.
        area: Solid angles of the texels, steradian.
    """
    around = kernel.sum(-1)
    rows, columns = torch.ones_like(covered), area
    for _ in range(MOST_BALANCING_ROUNDS):
        before, columns = columns, area / ((covered * rows) @ around)
        rows = 1 / (around @ columns)
        # The change of a column's factor is the relative error of that texel's energy before this round.
        if float((columns / before - 1).abs().max()) < ENERGY_TOLERANCE:
            break
    return rows[:, None, None] * kernel * columns[:, None]


def grid_solid_angles() -> Float[Tensor, " rows"]:
    """Solid angle, in steradian, of a grid point of each row under bilinear lookup; all points sum to 4 pi."""
    fine = 64 * GRID_HEIGHT
    direction = texel_directions(fine, 4)[:, 0]
    texel, share = bilinear_texels(direction, GRID_HEIGHT, GRID_WIDTH)
    ring = texel_solid_angles(fine, 1) * share / GRID_WIDTH
    return torch.zeros(GRID_HEIGHT, dtype=torch.float64).index_add(0, (texel // GRID_WIDTH).flatten(), ring.flatten())
