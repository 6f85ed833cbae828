"""Shading a surfel from its incident light (Eq. 8), with or without a specular lobe.

Without one, what the lobe would have scattered is scattered by Lambert's law: the surface is as bright on the whole,
and only how that is spread over directions is left out.
"""

from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..kernels.shade.brdf import FRESNEL_NORMAL
from ..kernels.shade.shade import shade
from .incident import Incident
from .splitsum import brdf_table


def shade_materials(
    normal: Float[Tensor, "surfels 3"],
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    outgoing: Float[Tensor, "surfels views 3"],
    incident: Incident,
    environment: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "surfels views 4 3"]:
    """The four parts of ``kernels.shade``. ``specular_at`` says which surfels have a lobe (None: all).

    Of the others none is evaluated, and what it would scatter is in their diffuse parts.
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
    """What each surfel scatters by Lambert's law: its albedo, and where it has no lobe that of the lobe it would have.

    ``specular_at`` says which have one (None: all). No gradient to roughness: without a lobe it shows by nothing but a
    brightness that albedo explains as well, and would be moved by the errors of albedo and light.
    """
    if specular_at is None:
        return albedo
    return albedo + torch.where(specular_at, 0.0, lobe_albedo(roughness.detach()))[:, None]


def lobe_albedo(roughness: Float[Tensor, " surfels"]) -> Float[Tensor, " surfels"]:
    """E(r), the hemispherical albedo of the specular lobe: the share of a white furnace's light that it scatters.

    E = 2 integral of n.wo (F0 A + B) d(n.wo) with A and B of ``brdf_integral``; 0.057 where smooth, 0.017 where rough.
    """
    table = _lobe_table().to(roughness)
    place = roughness * (len(table) - 1)
    left = place.detach().floor().clamp(0, len(table) - 2).long()
    return torch.lerp(table[left], table[left + 1], place - left)


@cache
def _lobe_table() -> Float[Tensor, " roughness"]:
    """E on the grid of roughness that A and B are stored on, float64."""
    scale, bias = brdf_table().double().unbind(-1)
    directional = FRESNEL_NORMAL * scale + bias
    step = 1 / (len(directional) - 1)
    # Integral of 2 n.wo over the hat of each entry: exact for what is linear between entries.
    weight = 2 * step * torch.linspace(0, 1, len(directional), dtype=torch.float64)
    weight[0], weight[-1] = step**2 / 3, step - step**2 / 3
    return weight @ directional
