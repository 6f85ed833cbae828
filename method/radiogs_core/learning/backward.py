"""The backward pass of a training step; a loss or gradient that is not finite raises an error before it spreads."""

import math
from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn.utils import get_total_norm

from ..instruments import require_finite


def backward(
    stage: str, iteration: int, losses: Mapping[str, Tensor], parameters: Mapping[str, Tensor]
) -> dict[str, float]:
    """Compute the gradients of the sum of the losses; returns the losses as numbers.

    Losses, gradients and parameters are checked before an optimiser uses them; NumericalFailure names the value that is
    not finite: a parameter and its surfel, if one is the cause. Numbers and checks are read together, so the call waits
    for the device once.
    """
    stacked = torch.stack(list(losses.values()))
    stacked.sum().backward()
    gradients = {name: value.grad for name, value in parameters.items() if value.grad is not None}
    with torch.no_grad():
        length = get_total_norm([*gradients.values(), *parameters.values()]).to(stacked)
    read = torch.cat([stacked.detach(), length.view(1)]).tolist()
    if not all(map(math.isfinite, read)):  # or a sum of finite squares overflows, which raises nothing
        require_finite(stage, iteration, {f"'{name}'": value.detach() for name, value in parameters.items()})
        require_finite(stage, iteration, {f"loss '{name}'": value for name, value in losses.items()})
        require_finite(stage, iteration, {f"the gradient of '{name}'": value for name, value in gradients.items()})
    return dict(zip(losses, read[: len(losses)], strict=True))
