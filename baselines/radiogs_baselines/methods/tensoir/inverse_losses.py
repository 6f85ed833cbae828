"""The losses of inverse rendering: marched pixels, shaded pixels, and what ties normals and materials down."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_encode

from .drawing import Drawn
from .field import Field
from .lighting import RecoveredLight
from .losses import facing_away, mean_along_rays, on_background, relative_difference, sparsity, squared_error
from .marching import Rays, march
from .model import Model
from .seen import Seen, seen_along
from .shading import surface_points
from .variant import Budget, Variant


def inverse_losses(
    model: Model, drawn: Drawn, variant: Variant, budget: Budget, generator: torch.Generator
) -> dict[str, Tensor]:
    """The weighted losses of some rays by name; ``generator`` displaces samples, directions and neighbours."""
    weights, field, rays = variant.learning.inverse, model.field, drawn.rays
    marched = march(field, rays, generator)
    seen = seen_along(field, rays, marched)
    marched_pixels = on_background(marched.blended(seen.radiance), marched.alpha, drawn.background, linear=True)
    light = RecoveredLight(model.light, variant, budget.light_rows, budget.secondary_samples, displaced=True)
    shaded_pixels = shaded_on_background(field, drawn, seen, light, generator)
    return {
        "radiance": weights.radiance * squared_error(marched_pixels, drawn.target),
        "shaded": weights.shaded * squared_error(shaded_pixels, drawn.target),
        "sparsity": weights.sparsity * sparsity(field),
        **_normal_losses(seen, rays, variant),
        **_smoothness(field, seen, variant, generator),
    }


def shaded_on_background(
    field: Field, drawn: Drawn, seen: Seen, light: RecoveredLight, generator: torch.Generator
) -> Float[Tensor, "rays 3"]:
    """Shaded pixels as display sRGB: clipped to [0, 1] before they are encoded; the background elsewhere."""
    points = surface_points(drawn.rays, seen.marched, seen.materials(light.variant.normals))
    shaded = light.on(field, points, generator)
    colour = srgb_encode((shaded.direct + shaded.indirect).clamp(0, 1))
    return drawn.background.expand(-1, 3).index_copy(0, points.ray, colour)


def _normal_losses(seen: Seen, rays: Rays, variant: Variant) -> dict[str, Tensor]:
    """Normals that are shaded with face the camera; predicted ones are those of the density."""
    weights, direction = variant.learning.inverse, rays.direction[seen.marched.ray]
    if variant.normals == "derived":
        away = facing_away(seen.derived, direction)
        return {"orientation": weights.orientation * mean_along_rays(seen.marched, away)}
    apart = (seen.predicted - seen.derived).square().sum(-1)
    away = facing_away(seen.predicted, direction)
    return {
        "normal difference": weights.normal_difference * mean_along_rays(seen.marched, apart),
        "orientation": weights.orientation * mean_along_rays(seen.marched, away),
    }


def _smoothness(field: Field, seen: Seen, variant: Variant, generator: torch.Generator) -> dict[str, Tensor]:
    """Materials here and a little beside."""
    weights, place = variant.learning.inverse, seen.marched.places
    drawn = torch.randn(place.shape, generator=generator, dtype=place.dtype, device=place.device)
    beside = place + variant.learning.nearby * drawn
    albedo, roughness = field.materials(field.features(beside), beside)
    of_albedo = relative_difference(seen.albedo, albedo)
    of_roughness = relative_difference(seen.roughness[:, None], roughness[:, None])
    return {
        "albedo smoothness": weights.albedo_smoothness * mean_along_rays(seen.marched, of_albedo),
        "roughness smoothness": weights.roughness_smoothness * mean_along_rays(seen.marched, of_roughness),
    }
