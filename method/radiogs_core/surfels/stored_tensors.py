"""Checks the shapes and values of a stored model's tensors before a kernel reads them.

Kernels do not check sizes: one would read beyond the end of a light map without texels. Surfels at NaN render black.
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
"""Shape of each raw parameter after its first axis, the surfels; ``sh`` may have the coefficients of fewer degrees."""

DEGREES = (1, 4, 9, 16)
"""Numbers of coefficients of the harmonics up to degree 0, 1, 2 and 3."""


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
        raise _wrong(str(sorted(map(str, foreign))[0]), "is not a parameter of surfels")
    return Surfels.of(stored)


def restored_map(stored: Mapping[str, object], name: str) -> Tensor:
    """A stored light map [height, width, 3]. Raises DataError if it is missing, misshapen or not finite."""
    value = finite_tensor(stored, name)
    require_map(value, f"'{name}' of the stored model")
    return value


def require_for_each(surfels: Surfels, name: str, value: Tensor, rest: Sequence[int]) -> None:
    """Raise DataError unless ``value`` has one entry of the shape ``rest`` for each surfel."""
    if tuple(value.shape) != (len(surfels), *rest):
        raise _wrong(name, f"has the shape {tuple(value.shape)}, for {len(surfels)} surfels")


def finite_tensor(stored: Mapping[str, object], name: str) -> Tensor:
    """A stored floating-point tensor. Raises DataError if it is missing, of another type, or not finite."""
    value = stored.get(name)
    if not isinstance(value, Tensor) or not value.is_floating_point():
        raise _wrong(name, "is missing, or is not a floating-point tensor")
    bad = int((~torch.isfinite(value)).sum())
    if bad:
        raise _wrong(name, f"holds {bad} values that are NaN or infinite, of {value.numel()}")
    return value


def _wrong(name: str, what: str) -> DataError:
    return DataError(
        f"'{name}' of the stored model {what}",
        "Another program wrote it, or it is damaged; rendering it would show a wrong image, or none.",
        "Train the model again, or restore its file from a copy.",
    )
