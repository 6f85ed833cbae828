"""Shading of surfel vertices from the table of incident light, and one-bounce radiance of rays' first hits."""

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d, normalize

from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.shading import shade_materials
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, DIFFUSE_INDIRECT, SPECULAR_DIRECT, SPECULAR_INDIRECT

from .model import Model
from .table import Table
from .vertices import bilinear, interpolated

SAMPLES_AT_ONCE = 1 << 22
"""Light samples that one-bounce radiance sums in one batch, at about fifty bytes each."""

Materials = Float[Tensor, "surfels vertices 7"]
"""Linear albedo, roughness and unit world normal of vertices."""


def materials_of(model: Model, albedo: Float[Tensor, "surfels vertices 3"]) -> Materials:
    """Materials of the model's vertices; ``albedo`` (linear) may differ from the model's: relighting scales it."""
    return torch.cat([albedo, model.roughness[..., None], model.normal], -1)


def shade_vertices(
    materials: Materials,
    incident: Incident,
    outgoing: Float[Tensor, "surfels 3"],
    environment: Float[Tensor, "rows columns 3"],
) -> tuple[Float[Tensor, "surfels vertices 3"], Float[Tensor, "surfels vertices 3"]]:
    """Linear direct and indirect radiance of vertices towards ``outgoing`` (unit, world), for some surfels.

    All vertices of a surfel receive the incident light of its centre.
    """
    surfels, vertices = materials.shape[:2]
    per_vertex = [
        value.repeat_interleave(vertices, 0)
        for value in (incident.direction, incident.weight, incident.visibility, incident.radiance, outgoing)
    ]
    albedo, roughness, normal = materials.flatten(0, 1).split([3, 1, 3], -1)
    parts = shade_materials(
        normal, albedo, roughness[:, 0], per_vertex[4][:, None], Incident(*per_vertex[:4]), environment
    )
    direct = parts[:, 0, DIFFUSE_DIRECT] + parts[:, 0, SPECULAR_DIRECT]
    indirect = parts[:, 0, DIFFUSE_INDIRECT] + parts[:, 0, SPECULAR_INDIRECT]
    return direct.view(surfels, vertices, 3), indirect.view(surfels, vertices, 3)


def one_bounce(
    materials: Materials,
    table: Table,
    surfel: Int[Tensor, " rays"],
    sample: Int[Tensor, " rays"],
    environment: Float[Tensor, "rows columns 3"],
    distance: float,
) -> Float[Tensor, "rays 3"]:
    """Radiance that the first hits of some rays reflect back along them, linear; lit by visible direct light only.

    The material is interpolated at the hit's (u, v); directions and visibility are the hit surfel's entries in the
    table. Normals have no gradient. ``surfel``, ``sample``: the surfel that each ray leaves, and the ray's index among
    the surfel's rays; the ray must have a first hit. ``distance``: see ``bilinear``.
    """
    hit, hit_uv = table.hit_surfel[surfel, sample], table.hit_uv[surfel, sample]
    weights = bilinear(hit_uv, distance, materials.shape[1])
    albedo, roughness, normal = interpolated(materials[hit], weights).split([3, 1, 3], -1)
    arriving = table.incident(hit, 0.0)
    outgoing = -table.direction[surfel, sample]
    parts = shade_materials(
        normalize(normal.detach(), dim=-1), albedo, roughness[:, 0], outgoing[:, None], arriving, environment
    )
    return parts[:, 0, DIFFUSE_DIRECT] + parts[:, 0, SPECULAR_DIRECT]


@torch.no_grad()
def bounced(
    materials: Materials, table: Table, environment: Float[Tensor, "rows columns 3"], distance: float
) -> Float[Tensor, "surfels samples 3"]:
    """``one_bounce`` of every ray of the table; zero for rays without a hit."""
    radiance = torch.zeros_like(table.direction)
    hits = torch.nonzero(table.hit_surfel >= 0)
    for surfel, sample in (some.unbind(-1) for some in hits.split(max(1, SAMPLES_AT_ONCE // table.weight.shape[1]))):
        radiance[surfel, sample] = one_bounce(materials, table, surfel, sample, environment, distance)
    return radiance


def mirrored(
    table: Table, surfels: Surfels, index: Int[Tensor, " chosen"], eye: Float[Tensor, "3"]
) -> tuple[Int[Tensor, " rays"], Int[Tensor, " rays"]]:
    """For each chosen surfel, the occluded ray nearest to the mirror direction of its view from ``eye``.

    The score of a ray is its cosine to the mirror direction times 1 - V. Returns surfel and ray indices of the surfels
    whose best score is positive and whose best ray has a hit.
    """
    normal = surfels.frame[index, :, 2].detach()
    view = normalize(eye - surfels.centre[index].detach(), dim=-1)
    mirror = 2 * (normal * view).sum(-1, keepdim=True) * normal - view
    score = (table.direction[index] * mirror[:, None]).sum(-1) * (1 - table.visibility[index])
    best, sample = score.max(-1)
    found = (best > 0) & (table.hit_surfel[index, sample] >= 0)
    return index[found], sample[found]


def downsampled(light: EnvironmentMap, rows: int | None) -> EnvironmentMap:
    """Downsample a light to ``rows`` rows by averaging; a light with no more rows is returned unchanged."""
    if rows is None or rows >= len(light.radiance):
        return light
    small = adaptive_avg_pool2d(light.radiance.permute(2, 0, 1)[None], (rows, 2 * rows))[0]
    return EnvironmentMap(small.permute(1, 2, 0))
