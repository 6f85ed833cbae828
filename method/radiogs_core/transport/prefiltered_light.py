"""Split-sum shading: prefiltered light times a pre-integrated BRDF (paper, initialisation and relighting)."""

from functools import cache, cached_property
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d

from ..kernels.shade.brdf import correlated_visibility, smith_visibility
from ..kernels.shade.lookup import look_up
from ..kernels.shade.splitsum import split_sum
from ..scene.light import texel_solid_angles
from .light_filters import LEVELS, filtered_light

LARGEST_HEIGHT = 32
"""Largest number of rows of a light before it is filtered."""

Masking = Literal["schlick", "height-correlated"]
"""Smith's masking and shadowing in the pre-integrated BRDF. "schlick": Schlick's approximation with k = (r + 1)^2 / 8,
as in shading by rays. "height-correlated": the exact term, as in the table that GS-IR, GI-GS and the released code of
RadioGS ship. At grazing views of smooth surfaces the latter reflects several times as much."""


class PrefilteredLight:
    """A light map, filtered for diffuse and glossy reflection (see ``light_filters``); differentiable in its texels.

    Args:
        radiance: Linear RGB, lat-long (see ``light``).
        masking: Masking of the pre-integrated BRDF by which the light is reflected.
    """

    sharp: Float[Tensor, "rows columns 3"]
    """The light, averaged by solid angle to at most LARGEST_HEIGHT rows. It is used at roughness 0: its texels are
    about as wide as the lobe of the first of LEVELS."""

    def __init__(self, radiance: Float[Tensor, "height width 3"], masking: Masking = "schlick") -> None:
        self.masking: Masking = masking
        height = min(radiance.shape[0], LARGEST_HEIGHT)
        if radiance.shape[:2] == (height, 2 * height):
            self.sharp = radiance
            return
        area = texel_solid_angles(*radiance.shape[:2]).to(radiance).expand(radiance.shape[:2])
        self.sharp = pooled(radiance * area[..., None], height) / pooled(area[..., None], height)

    @cached_property
    def diffuse(self) -> Float[Tensor, "rows columns 3"]:
        """Irradiance over pi, indexed by the normal."""
        # Separate from the glossy levels, because shading by rays needs only this map.
        return filtered_light(self.sharp, 1)[0]

    @cached_property
    def both(self) -> tuple[Float[Tensor, "rows columns 3"], Float[Tensor, "levels rows columns 3"]]:
        """``diffuse``, and light averaged over the GGX lobes of LEVELS, indexed by the mirrored view direction."""
        every = filtered_light(self.sharp, 1 + len(LEVELS))
        return every[0], every[1:]

    def irradiance(self, normal: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Unoccluded irradiance over pi, linear RGB: the radiance of a white Lambertian surface with this normal."""
        return look_up(self.diffuse, normal)


def split_sum_radiance(
    normal: Float[Tensor, "batch 3"],
    albedo: Float[Tensor, "batch 3"],
    roughness: Float[Tensor, " batch"],
    outgoing: Float[Tensor, "batch 3"],
    light: PrefilteredLight,
) -> tuple[Float[Tensor, "batch 3"], Float[Tensor, "batch 3"]]:
    """Diffuse and specular radiance, linear RGB, towards unit ``outgoing``, without occlusion; zero from behind."""
    table = brdf_table(light.masking).to(normal)
    diffuse, glossy = light.both
    both = split_sum(normal, albedo, roughness, outgoing, diffuse, glossy, light.sharp, table, LEVELS[0])
    return both[:, 0], both[:, 1]


def pooled(values: Float[Tensor, "height width _"], height: int) -> Float[Tensor, "rows columns _"]:
    """A map's values averaged over the texels of one with ``height`` rows."""
    return adaptive_avg_pool2d(values.permute(2, 0, 1), (height, 2 * height)).permute(1, 2, 0)


@cache
def brdf_table(masking: Masking = "schlick", size: int = 32, steps: int = 32) -> Float[Tensor, "view roughness 2"]:
    """A and B with F0 A + B = integral of f_s (n.wi), on a grid of n.wo by roughness in [0, 1]; float32.

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
    visibility = smith_visibility if masking == "schlick" else correlated_visibility
    lobe = 4 * visibility(*torch.broadcast_tensors(cosine, light_z.clamp(min=0), roughness))
    value = torch.where(valid, lobe * view_half * light_z / half_z, 0.0)
    bright = torch.exp2((-5.55473 * view_half - 6.98316) * view_half)
    return torch.stack([(value * (1 - bright)).mean((2, 3)), (value * bright).mean((2, 3))], -1).float()
