"""Kernels for split-sum shading (an item is some surface points) and for the lookup of light; forward and backward.

Light is read bilinearly from latitude-longitude grids (see ``light``): the diffuse grid along the normal, and along the
mirrored view direction the two glossy levels around the roughness, or the light itself below the first level. A and B
of the BRDF come from a table over n.wo and roughness.

The lookup computes texels and shares for a block of directions in loops over its lanes, which the CPU compiler
vectorises; arranged for CUDA, a block has one lane. The formula is that of ``scene.light.bilinear_texels``. A NaN
direction reads texels inside the map, with NaN shares.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, NATIVE, scalar_type, start_warp
from .angle import ANGLE, ATAN_TERMS
from .brdf import FRESNEL_NORMAL

_TEXT = native_file(__package__, "splitsum.inl", angle=ANGLE)


def points_an_item(on_cuda: bool) -> int:
    """Number of surface points that one item of the split-sum kernels shades."""
    return 1 if on_cuda else 64


@cache
def splitsum_kernels(dtype: torch.dtype, levels: int, first_level: float, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat.

    There are ``levels`` glossy maps, at the roughness ``first_level`` and its multiples.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    words = {
        "POINTS_AN_ITEM": str(points_an_item(on_cuda)),
        "FIRST_LEVEL": repr(first_level),
        "LEVELS": str(levels),
        "F0": repr(FRESNEL_NORMAL),
        "ATAN_TERMS": str(ATAN_TERMS[dtype]),
    }
    forward_text, backward_text = (native_text(_TEXT[part], dtype, on_cuda, words) for part in ("forward", "backward"))

    @wp.struct
    class Inputs:
        grid_height: wp.int32
        sharp_height: wp.int32
        sharp_width: wp.int32
        table_size: wp.int32
        normal: flat
        albedo: flat
        roughness: flat
        outgoing: flat
        diffuse: flat
        glossy: flat
        sharp: flat
        table: flat

    @wp.func_native(forward_text)
    def shade_points(item: wp.int32, given: Inputs, out: flat): ...

    @wp.func_native(backward_text)
    def pull_points(
        item: wp.int32,
        given: Inputs,
        pulls: flat,
        grad_normal: flat,
        grad_albedo: flat,
        grad_roughness: flat,
        grad_outgoing: flat,
        grad_diffuse: flat,
        grad_glossy: flat,
        grad_sharp: flat,
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(begin: wp.int32, given: Inputs, out: flat):
        shade_points(begin + wp.tid(), given, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32,
        given: Inputs,
        pulls: flat,
        grad_normal: flat,
        grad_albedo: flat,
        grad_roughness: flat,
        grad_outgoing: flat,
        grad_diffuse: flat,
        grad_glossy: flat,
        grad_sharp: flat,
    ):
        pull_points(
            begin + wp.tid(), given, pulls,
            grad_normal, grad_albedo, grad_roughness, grad_outgoing, grad_diffuse, grad_glossy, grad_sharp,
        )  # fmt: skip

    return SimpleNamespace(Inputs=Inputs, forward=forward, backward=backward)


_LOOKUP = native_file(__package__, "lookup.inl", angle=ANGLE)

LANES_ON_CPU = 16
"""Directions in a block on the CPU."""


@cache
def lookup_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; ``lanes``: directions of an item. All arrays are flat."""
    start_warp()
    scalar, lanes = scalar_type(dtype), 1 if on_cuda else LANES_ON_CPU
    flat = wp.array(dtype=scalar)
    words = {"DIRECTIONS_IN_A_BLOCK": str(lanes), "ATAN_TERMS": str(ATAN_TERMS[dtype])}
    forward_text, backward_text = (
        native_text(_LOOKUP[part], dtype, on_cuda, words) for part in ("forward", "backward")
    )

    @wp.func_native(forward_text)
    def look_up_block(
        block: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32,
        radiance: flat, direction: flat, out: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_block(
        block: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32, radiance: flat, direction: flat,
        pull: flat, wants_radiance: wp.int32, wants_direction: wp.int32, grad_direction: flat, grad_radiance: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32,
        radiance: flat, direction: flat, out: flat,
    ):  # fmt: skip
        look_up_block(begin + wp.tid(), directions, height, width, radiance, direction, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, directions: wp.int32, height: wp.int32, width: wp.int32, radiance: flat, direction: flat,
        pull: flat, wants_radiance: wp.int32, wants_direction: wp.int32, grad_direction: flat, grad_radiance: flat,
    ):  # fmt: skip
        pull_block(
            begin + wp.tid(), directions, height, width, radiance, direction,
            pull, wants_radiance, wants_direction, grad_direction, grad_radiance,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward, lanes=lanes)
