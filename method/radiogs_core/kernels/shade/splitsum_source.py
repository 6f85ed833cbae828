"""The kernels of split-sum shading: one item a surface point, forward and backward.

Light is read bilinearly from latitude-longitude grids (see ``light``): the diffuse grid along the normal; along the
mirrored view the two levels about the roughness, and the light itself below the sharpest level. A and B of the BRDF
come from a table over n.wo and roughness.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp
from .angle import ANGLE, ATAN_TERMS
from .brdf import FRESNEL_NORMAL

_TEXT = native_file(__package__, "splitsum.inl", angle=ANGLE)


@cache
def splitsum_kernels(dtype: torch.dtype, levels: int, first_level: float, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat.

    ``levels`` filtered maps, the first at roughness ``first_level``, the others at its multiples.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)
    words = {
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
    def shade_point(point: wp.int32, given: Inputs, out: flat): ...

    @wp.func_native(backward_text)
    def pull_point(
        point: wp.int32,
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
        shade_point(begin + wp.tid(), given, out)

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
        pull_point(
            begin + wp.tid(), given, pulls,
            grad_normal, grad_albedo, grad_roughness, grad_outgoing, grad_diffuse, grad_glossy, grad_sharp,
        )  # fmt: skip

    return SimpleNamespace(Inputs=Inputs, forward=forward, backward=backward)
