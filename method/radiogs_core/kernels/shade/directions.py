"""Turns a set of directions around +Z to the hemisphere of each surfel; no gradient."""

from functools import cache

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ..native_kernel import flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel

DIRECTIONS = native_file(__package__, "directions.inl")


def spread(
    normal: Float[Tensor, "surfels 3"],
    turn: Float[Tensor, " surfels"],
    shift: Float[Tensor, " surfels"] | None,
    around_z: Float[Tensor, "samples 3"],
    into: Float[Tensor, "surfels samples 3"],
) -> None:
    """Write a set of directions, turned around each normal, to ``into``.

    Args:
        normal: Unit normals in the world.
        turn: Azimuth of each surfel's set, in turns.
        shift: Where each surfel's samples lie in their bands of heights; None: as in the set.
        around_z: Unit directions of the set, around +Z.
        into: Contiguous memory of the result, unit directions in the world.
    """
    shifts = normal[:0, 0] if shift is None else shift
    arguments = [len(around_z), int(shift is not None), normal, turn, shifts.contiguous(), around_z, into]
    launch_in_parallel(spread_kernel(normal.dtype), len(normal), normal.device, arguments)


@cache
def spread_kernel(dtype: torch.dtype) -> wp.Kernel:
    """The kernel for a scalar type; an item is a surfel. ``shift`` is read if ``shifted``."""
    parameters = (wp.int32, "samples shifted"), (flat(dtype), "normal turn shift around_z direction")
    return native_kernel(DIRECTIONS, dtype, NATIVE, "spread", "surfel", *parameters)
