"""Radiometric consistency: the surfels' own radiance L_G must satisfy the rendering equation (paper, Eq. 6-9)."""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import random_hemisphere_direction
from radiogs_core.transport.shading import shade_materials
from radiogs_core.transport.splatting import towards
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance

from .variant import Variant


def consistency_loss(
    surfels: Surfels,
    environment: Float[Tensor, "height width 3"],
    camera: Camera,
    index: Int[Tensor, " chosen"],
    incident: Incident,
    variant: Variant,
    generator: torch.Generator,
    specular: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, ""]:
    """L_rad over the surfels ``index`` from the light ``incident`` on them.

    Per surfel the residual is taken towards the camera (where it faces it) and towards one direction drawn
    uniformly over its hemisphere, both from the same incident samples; the two l1-norms are added and averaged
    over surfels and channels. ``variant.detach`` stops the gradient of one side of the residual. ``specular``: which of
    all surfels have a specular lobe (None: all).
    """
    chosen = surfels.among(index)
    normal = chosen.frame[..., 2]
    with torch.no_grad():
        to_camera = towards(camera, chosen)
        outgoing = torch.stack([to_camera, random_hemisphere_direction(normal, generator)], 1)
        facing = ((outgoing * normal[:, None]).sum(-1) > 0)[..., None]
    if "light-detached" in variant.deviations:
        environment = environment.detach()
    physical = shade_materials(
        normal, chosen.albedo, chosen.roughness, outgoing, incident, environment,
        None if specular is None else specular[index],
    ).sum(2)  # fmt: skip
    own = surfel_radiance(chosen.sh, outgoing)
    if variant.detach == "pbr":
        physical = physical.detach()
    elif variant.detach == "surfel":
        own = own.detach()
    residual = torch.where(facing, own - physical, 0.0)
    return residual.abs().sum(1).mean()


def split_sum_consistency_loss(
    surfels: Surfels, light: PrefilteredLight, outgoing: Float[Tensor, "surfels 3"]
) -> tuple[Float[Tensor, ""], Float[Tensor, "surfels 3"]]:
    """The simplified L_rad of stage 1, over all surfels towards the camera, and the split-sum radiance itself."""
    normal = surfels.frame[..., 2]
    diffuse, specular = split_sum_radiance(normal, surfels.albedo, surfels.roughness, outgoing, light)
    physical = diffuse + specular
    facing = ((outgoing * normal).sum(-1) > 0)[:, None]
    residual = torch.where(facing, surfel_radiance(surfels.sh, outgoing) - physical, 0.0)
    return residual.abs().mean(), physical
