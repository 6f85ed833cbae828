"""What inverse rendering on shared surfels starts with: the light and the albedo that every method here begins from."""

from dataclasses import dataclass, field
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.learning.light_start import light_and_albedo, white_light
from radiogs_core.learning.light_start_settings import LightStart
from radiogs_core.learning.views import TrainingView
from radiogs_core.surfels.surfels import Surfels

GEOMETRY = ("centre", "rotation", "log_scale", "opacity_logit")
"""Raw parameters that say where surfels are and how opaque."""


@dataclass(frozen=True)
class LightAndPaint:
    """The light that a stage starts with, and the paint under it; each method's own values are its subclass's."""

    light: Literal["least-variation", "constant"] = "least-variation"
    """The light under which albedo varies least, with the albedo that follows from it, which RadioGS starts with here,
    too; or a constant light and a constant albedo, as in the methods' own scripts."""
    search: LightStart = field(default_factory=LightStart)
    """How the light of least variation is found."""
    albedo: float = 0.5
    """Linear diffuse albedo of all channels under a constant light."""
    roughness: float = 0.5
    """Perceptual roughness r."""
    white: float = 0.8
    """Albedo of white paint. A constant light starts so that the brightest surfaces seen are that under it; the scripts
    start at fixed radiances, whatever the images' exposure."""
    brightest: float = 0.98
    """Quantile of the covered pixels that counts as the brightest."""


def first_light_and_albedo(
    learnt: Surfels,
    views: tuple[TrainingView, ...],
    rows: int,
    start: LightAndPaint,
    generator: torch.Generator,
    two_sided: bool = True,
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "surfels 3"]]:
    """A light of ``rows`` rows and the albedo of the surfels that stage 1 has learnt, both linear.

    A light is constant, too, where too few points are seen to look for another one (see ``light_and_albedo``).
    """
    found = None
    if start.light == "least-variation":
        found = light_and_albedo(learnt, views, rows, start.search, generator, two_sided)
    if found is not None:
        return found
    level = white_light(views, start.white, start.brightest)
    return learnt.centre.new_full((rows, 2 * rows, 3), level), torch.full_like(learnt.albedo_logit, start.albedo)
