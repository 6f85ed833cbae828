"""Losses to gradients; a value that is not finite stops training before it spreads."""

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from ..instruments import require_finite


def backward(
    stage: str, iteration: int, losses: Mapping[str, Tensor], parameters: Mapping[str, Tensor]
) -> dict[str, float]:
    """Add the losses up and propagate them; returns them as numbers.

    Losses and gradients are checked before anyone steps on them. A device is waited for once: numbers and checks are
    read together. Where a loss is not finite because a parameter was not, that parameter and its surfel are named, not
    the loss. Raises NumericalFailure.
    """
    torch.stack(list(losses.values())).sum().backward()
    gradients = {name: value.grad for name, value in parameters.items() if value.grad is not None}
    scalars = [*(value.detach() for value in losses.values()), *(gradient.sum() for gradient in gradients.values())]
    read = torch.stack(scalars).tolist()
    if not all(map(math.isfinite, read)):
        _name_what_is_not_finite(stage, iteration, losses, parameters, gradients)
    return dict(zip(losses, read[: len(losses)], strict=True))


def _name_what_is_not_finite(
    stage: str,
    iteration: int,
    losses: Mapping[str, Tensor],
    parameters: Mapping[str, Tensor],
    gradients: Mapping[str, Tensor],
) -> None:
    """Raise NumericalFailure, unless all entries are finite and only their sum overflows."""
    if not all(bool(torch.isfinite(value)) for value in losses.values()):
        require_finite(stage, iteration, {f"'{name}'": value.detach() for name, value in parameters.items()})
    require_finite(stage, iteration, {f"loss '{name}'": value for name, value in losses.items()})
    require_finite(stage, iteration, {f"the gradient of '{name}'": value for name, value in gradients.items()})
