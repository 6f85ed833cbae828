"""Shading a surfel from its incident light (Eq. 8), with or without a specular lobe.

Without a lobe, Lambert's law scatters the light that the lobe would scatter: the reflected energy stays the same, and
only its dependence on direction is lost.
"""

from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..kernels.shade.brdf import FRESNEL_NORMAL
from ..kernels.shade.shade import shade
from .incident import Incident
from .prefiltered_light import brdf_table


def shade_materials(
    normal: Float[Tensor, "surfels 3"],
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    outgoing: Float[Tensor, "surfels views 3"],
    incident: Incident,
    environment: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "surfels views 4 3"]:
    """The four parts of ``kernels.shade``, linear RGB. ``specular_at``: whether each surfel has a lobe (None: all).

    No lobe is evaluated for the other surfels; their diffuse parts contain the energy that it would scatter.
    """
    return shade(
        normal, lambert_albedo(albedo, roughness, specular_at), roughness, outgoing,
        incident.direction, incident.weight, incident.visibility, incident.radiance, environment, specular_at,
    )  # fmt: skip


def lambert_albedo(
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    specular_at: Bool[Tensor, " surfels"] | None,
) -> Float[Tensor, "surfels 3"]:
    """Lambertian albedo of each surfel: its albedo, plus ``lobe_albedo`` where it has no specular lobe.

    ``specular_at``: whether each surfel has a lobe (None: all). Roughness gets no gradient: without a lobe it only
    changes the brightness, as albedo does, so errors of albedo and light would move it.
    """
    if specular_at is None:
        return albedo
    return albedo + torch.where(specular_at, 0.0, lobe_albedo(roughness.detach()))[:, None]


def bounded_albedo(
    albedo: Float[Tensor, "surfels 3"], roughness: Float[Tensor, " surfels"]
) -> Float[Tensor, "surfels 3"]:
    """The albedo, lowered where it and ``lobe_albedo`` are more than 1: such a surface would send more than it gets.

    An albedo in the factor of images, which relighting multiplies, can be larger. Bounces would then never die out.
    """
    return torch.minimum(albedo.clamp(min=0), 1 - lobe_albedo(roughness)[:, None])


def lobe_albedo(roughness: Float[Tensor, " surfels"]) -> Float[Tensor, " surfels"]:
    """E(r), the hemispherical albedo of the specular lobe: the share of a white furnace's light that it scatters.

    E = 2 integral of n.wo (F0 A + B) d(n.wo) with A and B of ``brdf_table``; 0.057 at roughness 0, 0.017 at 1.
    """
    table = _lobe_table().to(roughness)
    entry = roughness * (len(table) - 1)
    left = entry.detach().floor().clamp(0, len(table) - 2).long()
    return torch.lerp(table[left], table[left + 1], entry - left)


@cache
def _lobe_table() -> Float[Tensor, " roughness"]:
    """E on the grid of roughness that A and B are stored on, float64."""
    scale, bias = brdf_table().double().unbind(-1)
    directional = FRESNEL_NORMAL * scale + bias
    step = 1 / (len(directional) - 1)
    # Integral of 2 n.wo times the hat function of each entry: exact for functions that are linear between entries.
    weight = 2 * step * torch.linspace(0, 1, len(directional), dtype=torch.float64)
    weight[0], weight[-1] = step**2 / 3, step - step**2 / 3
    return weight @ directional
