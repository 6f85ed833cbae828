"""Incident light of a surfel: the environment multiplied by V, plus the surfel's local light."""

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.transport.incident import Incident

from .settings import LocalLight
from .visibility import VisibilityTable


def local_radiance(
    harmonics: Float[Tensor, "surfels 16 3"], direction: Float[Tensor, "surfels samples 3"]
) -> Float[Tensor, "surfels samples 3"]:
    """max(0, sum_lm h_lm Y_lm(w)): linear radiance from unit ``direction``, in the basis and signs of 3DGS.

    Where the sum is exactly zero, as at the start, the gradient passes.
    """
    return harmonic_sum(harmonics, direction).clamp(min=0)


def arriving(table: VisibilityTable, harmonics: Float[Tensor, "surfels 16 3"], local: LocalLight) -> Incident:
    """Incident light with V from the table and local light as its indirect radiance; gradient to ``harmonics``."""
    if local == "none":
        return Incident(table.direction, table.weight, table.visibility, torch.zeros_like(table.direction))
    radiance = local_radiance(harmonics, table.direction)
    if local == "gated":
        radiance = radiance * (1 - table.visibility[..., None])
    return Incident(table.direction, table.weight, table.visibility, radiance)
