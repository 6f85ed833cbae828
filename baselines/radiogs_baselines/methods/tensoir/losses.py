"""Losses of marched rays and of the field's factors."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.colour import srgb_decode, srgb_encode

from .field import Field
from .marching import Marched

VARIATION = 0.02
"""Factor on the mean squared differences that the published weights of variation include."""

DARKEST = 1e-6
"""Lower limit of the denominator of relative differences."""


def on_background(
    blended: Float[Tensor, "rays 3"], alpha: Float[Tensor, " rays"], background: Float[Tensor, "rays 1"], linear: bool
) -> Float[Tensor, "rays 3"]:
    """Composite blended radiance on a background (display sRGB) and return display values.

    ``linear`` radiance is composited on the decoded background and then encoded; otherwise radiance is display values.
    """
    left = (1 - alpha)[:, None]
    return srgb_encode(blended + left * srgb_decode(background)) if linear else blended + left * background


def squared_error(found: Float[Tensor, "rays 3"], target: Float[Tensor, "rays 3"]) -> Float[Tensor, ""]:
    """Mean squared error over rays and channels; 0 without rays."""
    return (found - target).square().sum() / max(1, target.numel())


def sparsity(field: Field) -> Float[Tensor, ""]:
    """Mean absolute entry of each density plane and line, summed over the three factors."""
    plane, line = field.parameters["density_plane"], field.parameters["density_line"]
    return 3 * (plane.abs().mean() + line.abs().mean())


def variation(planes: Float[Tensor, "3 size size components"]) -> Float[Tensor, ""]:
    """Mean squared differences of neighbouring entries along both axes, summed over the planes, times ``VARIATION``."""
    down, across = planes.diff(dim=1), planes.diff(dim=2)
    return 3 * VARIATION * (down.square().mean() + across.square().mean())


def mean_along_rays(marched: Marched, values: Float[Tensor, " counted"]) -> Float[Tensor, ""]:
    """Blend values of the counted samples along each ray, and average over all rays."""
    return marched.blended(values).sum() / max(1, marched.samples.rays)


def facing_away(normal: Float[Tensor, "counted 3"], direction: Float[Tensor, "counted 3"]) -> Float[Tensor, " counted"]:
    """Squared cosine between normals and unit viewing directions where it is positive; zero elsewhere."""
    return (normal * direction).sum(-1).clamp(min=0).square()


def relative_difference(
    here: Float[Tensor, "counted channels"], nearby: Float[Tensor, "counted channels"]
) -> Float[Tensor, " counted"]:
    """Squared differences relative to the larger of both values, summed over channels."""
    larger = torch.maximum(here, nearby).clamp(min=DARKEST)
    return ((here - nearby) / larger).square().sum(-1)
