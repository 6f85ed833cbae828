"""Shading of vertices from the table of their surfel, and of the first hits of rays after one bounce."""

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
"""Samples of light that one-bounce radiance is summed from at a time, some fifty bytes each."""

Materials = Float[Tensor, "surfels vertices 7"]
"""Albedo, roughness and unit normal of vertices."""


def materials_of(model: Model, albedo: Float[Tensor, "surfels vertices 3"]) -> Materials:
    """Those of the model's vertices; ``albedo`` is given apart, because relighting scales it."""
    return torch.cat([albedo, model.roughness[..., None], model.normal], -1)


def shade_vertices(
    materials: Materials,
    incident: Incident,
    outgoing: Float[Tensor, "surfels 3"],
    environment: Float[Tensor, "rows columns 3"],
) -> tuple[Float[Tensor, "surfels vertices 3"], Float[Tensor, "surfels vertices 3"]]:
    """Linear radiance of vertices towards ``outgoing``, after one surface and after more, of some surfels.

    All vertices of a surfel receive what arrives at its centre.
    """
    surfels, vertices = materials.shape[:2]
    of_each = [
        value.repeat_interleave(vertices, 0)
        for value in (incident.direction, incident.weight, incident.visibility, incident.radiance, outgoing)
    ]
    albedo, roughness, normal = materials.flatten(0, 1).split([3, 1, 3], -1)
    parts = shade_materials(normal, albedo, roughness[:, 0], of_each[4][:, None], Incident(*of_each[:4]), environment)
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
    """What the first hits of some rays of the table send back along them, linear: only the light, as far as it is seen.

    The material is that of the hit's own (u, v); directions and visibility are its surfel's in the table. Each ray has
    to have a first hit. No gradient to normals. ``distance``: of the vertices (see ``bilinear``).
    """
    met, place = table.first[surfel, sample], table.place[surfel, sample]
    weights = bilinear(place, distance, materials.shape[1])
    albedo, roughness, normal = interpolated(materials[met], weights).split([3, 1, 3], -1)
    arriving = table.incident(met, 0.0)
    outgoing = -table.direction[surfel, sample]
    parts = shade_materials(
        normalize(normal.detach(), dim=-1), albedo, roughness[:, 0], outgoing[:, None], arriving, environment
    )
    return parts[:, 0, DIFFUSE_DIRECT] + parts[:, 0, SPECULAR_DIRECT]


@torch.no_grad()
def bounced(
    materials: Materials, table: Table, environment: Float[Tensor, "rows columns 3"], distance: float
) -> Float[Tensor, "surfels samples 3"]:
    """``one_bounce`` for every ray of the table, zero where nothing is met."""
    radiance = torch.zeros_like(table.direction)
    met = torch.nonzero(table.first >= 0)
    for surfel, sample in (some.unbind(-1) for some in met.split(max(1, SAMPLES_AT_ONCE // table.weight.shape[1]))):
        radiance[surfel, sample] = one_bounce(materials, table, surfel, sample, environment, distance)
    return radiance


def mirrored(
    table: Table, surfels: Surfels, index: Int[Tensor, " chosen"], eye: Float[Tensor, "3"]
) -> tuple[Int[Tensor, " rays"], Int[Tensor, " rays"]]:
    """For each of some surfels, the ray nearest to the mirror image of its view from ``eye``, the nearer the more it is
    occluded; those that have one, and which it is."""
    normal = surfels.frame[index, :, 2].detach()
    view = normalize(eye - surfels.centre[index].detach(), dim=-1)
    mirror = 2 * (normal * view).sum(-1, keepdim=True) * normal - view
    score = (table.direction[index] * mirror[:, None]).sum(-1) * (1 - table.visibility[index])
    best, sample = score.max(-1)
    found = (best > 0) & (table.first[index, sample] >= 0)
    return index[found], sample[found]


def limited(environment: Float[Tensor, "rows columns 3"], limit: float) -> Float[Tensor, "rows columns 3"]:
    """A light as it is looked up."""
    return environment.clamp(0, limit)


def reduced(light: EnvironmentMap, rows: int | None) -> EnvironmentMap:
    """A light averaged over the texels of a map of ``rows`` rows; as it is where it has no more."""
    if rows is None or rows >= len(light.radiance):
        return light
    small = adaptive_avg_pool2d(light.radiance.permute(2, 0, 1)[None], (rows, 2 * rows))[0]
    return EnvironmentMap(small.permute(1, 2, 0))
