"""Maps of a view for evaluation and display; training does not use them."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ..kernels.image.display import displayed
from ..kernels.rasterize.rasterize import blend
from ..scene.camera import Camera
from ..scene.light import EnvironmentMap
from ..surfels.surfels import Surfels
from .incident import Incident
from .prefiltered_light import PrefilteredLight, split_sum_radiance
from .splatting import (
    DIFFUSE_DIRECT,
    DIFFUSE_INDIRECT,
    SPECULAR_DIRECT,
    SPECULAR_INDIRECT,
    Splat,
    shade_surfels,
    splat,
    towards,
    unit_or_zero,
)


@torch.no_grad()
def shaded_maps(
    camera: Camera,
    surfels: Surfels,
    albedo: Float[Tensor, "surfels 3"],
    incident: Incident,
    environment: Float[Tensor, "rows columns 3"],
    specular_at: Bool[Tensor, " surfels"] | None = None,
    straight: bool = True,
) -> dict[str, Float[Tensor, "height width _"]]:
    """All maps of one view under a given light.

    The maps are ``image`` (display sRGB, clipped, on black), ``direct``, ``indirect``, ``albedo``, ``roughness``,
    ``alpha``, ``normal`` and ``depth``; see ``MapName``. The first five are multiplied by alpha.

    Args:
        camera: Camera of the view.
        surfels: The model.
        albedo: Linear albedo, used instead of ``surfels.albedo``, because relighting scales it.
        incident: Incident light of every surfel.
        environment: Distant light, linear RGB, lat-long (see ``light``).
        specular_at: Whether each surfel has a specular lobe; None: all have one.
        straight: How partly covered pixels are encoded; see ``displayed``.
    """
    parts = shade_surfels(surfels, albedo, incident, towards(camera, surfels)[:, None], environment, specular_at)[:, 0]
    direct = parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]
    return _maps(camera, surfels, albedo, direct, parts[:, DIFFUSE_INDIRECT] + parts[:, SPECULAR_INDIRECT], straight)


def _maps(
    camera: Camera, surfels: Surfels, albedo: Tensor, direct: Tensor, indirect: Tensor, straight: bool
) -> dict[str, Tensor]:
    channels = {"direct": direct, "indirect": indirect, "albedo": albedo, "roughness": surfels.roughness[:, None]}
    seen = splat(camera, surfels, channels, depth_unit=1.0)
    image = displayed(seen.images["direct"] + seen.images["indirect"], seen.alpha, straight).clamp(0, 1)
    return {**seen.images, "image": image, **blended_maps(seen)}


def blended_maps(seen: Splat) -> dict[str, Float[Tensor, "height width _"]]:
    """The maps that do not depend on shading; ``seen`` has the channels ``albedo`` and ``roughness``."""
    return {
        "albedo": seen.images["albedo"],
        "roughness": seen.images["roughness"],
        "alpha": seen.alpha[..., None],
        "normal": unit_or_zero(seen.normal),
        "depth": seen.depth[..., None],
    }


@torch.no_grad()
def radiance_maps(
    camera: Camera, surfels: Surfels, straight: bool = True
) -> dict[str, Float[Tensor, "height width _"]]:
    """The surfels' own radiance L_G in a camera: ``image`` (display sRGB, clipped, on black) and ``alpha``."""
    seen = surfels.seen_by(camera, radiance=True, shown_only=True)
    assert seen.radiance is not None
    raster = blend(seen, seen.radiance, depth_unit=1.0)
    return {"image": displayed(raster.features, raster.alpha, straight).clamp(0, 1), "alpha": raster.alpha[..., None]}


def mean_incident(
    incident: Incident, environment: Float[Tensor, "rows columns 3"]
) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "points 3"]]:
    """Mean over each point's directions of L_ind and of V L_env, linear RGB: the paper's incident radiance, "the mean
    value of the samples" (appendix, illumination components). It has neither cosine nor albedo. Zero without weight.
    """
    weight = incident.weight[..., None]
    total = weight.sum(1)
    share = weight / torch.where(total > 0, total, 1.0)[:, None]
    direct = incident.visibility[..., None] * EnvironmentMap(environment).lookup(incident.direction)
    return (share * incident.radiance).sum(1), (share * direct).sum(1)


@torch.no_grad()
def incident_maps(
    camera: Camera, surfels: Surfels, incident: Incident, environment: Float[Tensor, "rows columns 3"]
) -> dict[str, Float[Tensor, "height width 3"]]:
    """The mean incident radiance of surfels as images, ``incident`` (indirect; the released RadioGS code writes it as
    ``light_indirect``) and ``incident_direct``; linear RGB, on black.
    """
    indirect, direct = mean_incident(incident, environment)
    return dict(splat(camera, surfels, {"incident": indirect, "incident_direct": direct}, depth_unit=1.0).images)


@torch.no_grad()
def split_sum_maps(
    camera: Camera, surfels: Surfels, light: PrefilteredLight, straight: bool = True
) -> dict[str, Float[Tensor, "height width _"]]:
    """The maps of ``shaded_maps``, shaded by the split sum: without occlusion and without indirect light."""
    diffuse, specular = split_sum_radiance(
        surfels.frame[..., 2], surfels.albedo, surfels.roughness, towards(camera, surfels), light
    )
    direct = diffuse + specular
    return _maps(camera, surfels, surfels.albedo, direct, torch.zeros_like(direct), straight)
