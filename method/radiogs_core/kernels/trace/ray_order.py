"""Orders in which consecutive rays visit the same nodes of the tree."""

from functools import cache

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from ...errors import UsageError
from ..native_kernel import INTEGERS, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel, scalar_type

RAY_ORDER = native_file(__package__, "ray_order.inl")


@torch.no_grad()
def ordered_by_origin(
    origin: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"], of_origin: int
) -> Int[Tensor, " rays"]:
    """Ray numbers with the ``of_origin`` rays of each origin together, origins in the order of their first rays.

    Raises UsageError unless the number of rays is a multiple of ``of_origin``.
    """
    if len(origin) % of_origin:
        raise UsageError(
            f"{len(origin)} rays are no multiple of {of_origin}",
            "As many consecutive rays are said to have the same origin.",
            "Trace as many rays from every origin, or leave rays_of_origin out.",
        )
    first = coherent_order(origin[::of_origin], direction[::of_origin])
    return (first[:, None] * of_origin + torch.arange(of_origin, dtype=torch.int32, device=first.device)).flatten()


CELLS = 512
"""Cells along the longest side of the box around the origins: 9 bits for each of three coordinates."""

BOUNDED = 16
"""The box holds every 16th origin; origins outside it count in its outermost cells. Finding the box of all origins
would take longer than sorting them."""


@torch.no_grad()
def coherent_order(origin: Float[Tensor, "rays 3"], direction: Float[Tensor, "rays 3"]) -> Int[Tensor, " rays"]:
    """Ray numbers sorted by the octant of the ray's direction, then along a Morton curve through the origins.

    Tracing in this order measured 1.3 to 1.8 times as fast as in random order; the octant contributes 2 to 5 %.
    """
    count, device = len(origin), origin.device
    code = torch.empty(count, dtype=torch.int32, device=device)
    if count > 0:
        low, high = torch.stack(torch.aminmax(origin[::BOUNDED], dim=0)).tolist()
        span = max(end - begin for begin, end in zip(low, high, strict=True))
        cells = (CELLS - 1) / span if span > 0 else 0.0
        arguments = [origin.contiguous(), direction.contiguous(), wp.vec3d(*low), cells, code]
        launch_in_parallel(code_kernel(origin.dtype), count, device, arguments)
    return code.argsort(stable=True).int()


@cache
def code_kernel(dtype: torch.dtype) -> wp.Kernel:
    """The kernel of the numbers by which rays are sorted, for a scalar type; an item is a ray."""
    arrays = flat(dtype)
    parameters = (arrays, "origin direction"), (wp.vec3d, "low"), (scalar_type(dtype), "cells"), (INTEGERS, "out")
    return native_kernel(RAY_ORDER, dtype, NATIVE, "code", "ray", *parameters, words={"CELLS": CELLS})
