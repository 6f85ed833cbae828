"""Stored tensors as parts of a model: their shapes and values are looked at before a kernel reads them.

A kernel takes sizes on trust. A map of light without texels would be read beyond its end, surfels at NaN render black.
"""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from ..errors import DataError
from ..scene.light import require_map
from .harmonics import COEFFICIENTS
from .surfels import Surfels

SHAPES: Mapping[str, tuple[int, ...]] = {
    "centre": (3,),
    "rotation": (4,),
    "log_scale": (2,),
    "opacity_logit": (),
    "sh": (COEFFICIENTS, 3),
    "albedo_logit": (3,),
    "roughness_logit": (),
}
"""What follows the number of surfels in the shape of each raw parameter; harmonics may end at a lower degree."""

DEGREES = (1, 4, 9, 16)
"""Coefficients of the harmonics up to degree 0, 1, 2 and 3."""


def restored_surfels(stored: object) -> Surfels:
    """The surfels of a stored model. Raises DataError for tensors that are missing, misshapen or not finite."""
    if not isinstance(stored, Mapping):
        raise _wrong("surfels", f"is {type(stored).__name__}")
    count = None
    for name, rest in SHAPES.items():
        value = finite_tensor(stored, name)
        count = len(value) if count is None and value.ndim else count
        shape = tuple(value.shape)
        lower = name == "sh" and len(shape) == 3 and shape[1] in DEGREES and shape[2] == 3 and shape[0] == count
        if shape != (count, *rest) and not lower:
            raise _wrong(name, f"has the shape {shape}, for {count} surfels")
    foreign = stored.keys() - SHAPES.keys()
    if foreign:
        raise _wrong(str(sorted(map(str, foreign))[0]), "is no parameter of surfels")
    return Surfels.of(stored)


def restored_map(stored: Mapping[str, object], name: str) -> Tensor:
    """A map of light [height, width, 3] of a stored model, as it is learnt. Raises DataError as above."""
    value = finite_tensor(stored, name)
    require_map(value, f"'{name}' of the stored model")
    return value


def require_for_each(surfels: Surfels, name: str, value: Tensor, rest: Sequence[int]) -> None:
    """Raise DataError for a tensor that has not one entry of the shape ``rest`` for each surfel."""
    if tuple(value.shape) != (len(surfels), *rest):
        raise _wrong(name, f"has the shape {tuple(value.shape)}, for {len(surfels)} surfels")


def finite_tensor(stored: Mapping[str, object], name: str) -> Tensor:
    """A tensor of floating point of a stored model. Raises DataError where there is none, or where it is not finite."""
    value = stored.get(name)
    if not isinstance(value, Tensor) or not value.is_floating_point():
        raise _wrong(name, "is missing, or no tensor of floating point")
    bad = int((~torch.isfinite(value)).sum())
    if bad:
        raise _wrong(name, f"holds {bad} values that are NaN or infinite, of {value.numel()}")
    return value


def _wrong(name: str, what: str) -> DataError:
    return DataError(
        f"'{name}' of the stored model {what}",
        "It was written by another program, or is damaged; rendering it would show something else, or nothing.",
        "Train the model again, or put its file back.",
    )
