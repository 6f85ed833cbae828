"""Losses to gradients; a value that is not finite stops training before it spreads."""

from collections.abc import Mapping

import torch
from torch import Tensor

from ..instruments.finite import require_finite


def backward(stage: str, iteration: int, losses: Mapping[str, Tensor], parameters: Mapping[str, Tensor]) -> None:
    """Add the losses up and propagate them; losses and gradients are checked before anyone steps on them.

    Where a loss is not finite because a parameter was not, that parameter and its surfel are named, not the loss.
    """
    if not all(bool(torch.isfinite(value)) for value in losses.values()):
        require_finite(stage, iteration, {f"'{name}'": value.detach() for name, value in parameters.items()})
    require_finite(stage, iteration, {f"loss '{name}'": value for name, value in losses.items()})
    torch.stack(list(losses.values())).sum().backward()
    gradients = {
        f"the gradient of '{name}'": value.grad for name, value in parameters.items() if value.grad is not None
    }
    require_finite(stage, iteration, gradients)
