"""A non-finite value stops training at once, with the name of the tensor, the surfel and the iteration."""

from collections.abc import Mapping

import torch
from torch import Tensor

from ..errors import NumericalFailure
from .recording import fire


def require_finite(stage: str, iteration: int, values: Mapping[str, Tensor]) -> None:
    """Raise NumericalFailure if any of the named tensors holds a NaN or an infinity."""
    for name, value in values.items():
        if bool(torch.isfinite(value.sum())):
            continue
        bad = torch.nonzero(~torch.isfinite(value.reshape(value.shape[0], -1) if value.dim() else value[None, None]))
        if len(bad) == 0:
            continue  # finite entries whose sum overflows
        fire(broken_training=1)
        raise NumericalFailure(
            f"{name} is not finite in stage '{stage}' at iteration {iteration}{_where(name, value, bad)}",
            "Training on would spread it to every surfel.",
            "Look at what made that value: the last step, or what the stage began from.",
        )


def _where(name: str, value: Tensor, bad: Tensor) -> str:
    """The first bad row of a tensor: a surfel, but for the environment, whose rows are those of the map."""
    if not value.dim():
        return ""
    return f": {'row' if 'environment' in name else 'surfel'} {int(bad[0, 0])} ({len(bad)} values in all)"


def require_finite_blend(name: str, blended: Tensor, given: Mapping[str, Tensor]) -> None:
    """Raise NumericalFailure if what was blended over surfels (a row a pixel or a ray) is not finite.

    ``given`` are the per-surfel values that were blended, to name the surfel. Geometry that is not finite is never met,
    but a surfel that is met spreads a NaN in its colour over the image. One sum is all that a sound image costs; with
    gradient there is not even that, because ``backward`` checks the losses and says in which iteration.
    """
    if blended.requires_grad or bool(torch.isfinite(blended.detach().sum())) or bool(torch.isfinite(blended).all()):
        return
    fire(broken_colours=1)
    broken = [
        f"'{what}' of surfel {int(rows[0])} ({len(rows)} in all)"
        for what, values in given.items()
        if len(rows := torch.nonzero(~torch.isfinite(values).flatten(1).all(-1))[:, 0])
    ]
    raise NumericalFailure(
        f"{name} are not finite: {' and '.join(broken) or 'finite values of several surfels add up to infinity'}",
        "Every pixel and ray that meets such a surfel is lost.",
        "Look at what made the surfels: a file that was read, or the last step of training.",
    )
