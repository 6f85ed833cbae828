"""The losses of shaded pixels; those of whole maps are in ``radiogs_core.learning.losses``."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.image.display import displayed
from radiogs_core.learning.losses import light_prior
from radiogs_core.transport.incident import Incident

from .shading import mean_direct_light


def pixel_loss(
    radiance: Float[Tensor, "pixels 3"],
    alpha: Float[Tensor, " pixels"],
    target: Float[Tensor, "pixels 3"],
    straight: bool = True,
) -> Float[Tensor, ""]:
    """Mean L1 between shaded pixels and the training image on black, display sRGB; 0 for no pixels.

    radiance: linear, of the covered part of each pixel. straight: see ``splatting.displayed``. Where the target is
    saturated it only says "at least 1", as in ``learning.losses.reconstruction``.
    """
    found = displayed((radiance * alpha[:, None])[None], alpha[None], straight)[0]
    found = torch.where(target >= 1, found.clamp(max=1), found)
    return (found - target).abs().sum() / max(1, target.numel())


def neutrality(incident: Incident, environment: Float[Tensor, "rows columns 3"]) -> Float[Tensor, ""]:
    """Mean distance of the channels of V L_env, averaged over each point's hemisphere, from their mean; 0 for none."""
    if not len(incident.weight):
        return environment.new_zeros(())
    return light_prior(mean_direct_light(incident, environment))
