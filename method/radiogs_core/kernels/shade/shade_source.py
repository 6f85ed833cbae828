"""Kernels for shading: one item a surfel, a loop over its samples and views, forward and backward.

With s = wo + wi along the half-vector and F, V and D the terms of ``brdf``, each sample adds

    weight (n.wi) { albedo / pi, D F V } x { visibility Env(wi), L_ind }

to the four sums. The backward pass evaluates the same terms again instead of storing them.

Both passes are native snippets that process samples in blocks of LANES and finish each step for a whole block before
the next. These are plain loops over the lanes, which the CPU compiler vectorises (one sample at a time, with the
library's atan2 and pow, measured 4 times slower). Arranged for CUDA, the same text has one lane. A lane without a
sample, or with a sample below the horizon, uses the normal as its direction and weight zero, so its terms are finite
and contribute zero.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .angle import ANGLE, ATAN_TERMS
from .brdf import FRESNEL_NORMAL

_TEXT = native_file(__package__, "shade.inl", lanes=LANES, angle=ANGLE)

LANES_ON_CPU = 16
"""Samples in a block on the CPU; with 8 it measured 25 % slower, with 32 and 64 the same."""

EXP_TERMS = {torch.float32: 8, torch.float64: 15}
"""Number of terms of exp's series, for arguments down to -0.55, that reach the last digit of each type."""

TEXEL = 4
"""Numbers of a texel of the light in memory: three channels and one for padding, so that it is a vector of four."""


@cache
def shade_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat."""
    start_warp()
    scalar = scalar_type(dtype)
    flat = wp.array(dtype=scalar)

    @wp.struct
    class Inputs:
        views: wp.int32
        samples: wp.int32
        height: wp.int32
        width: wp.int32
        normal: flat
        albedo: flat
        roughness: flat
        outgoing: flat
        direction: flat
        weight: flat
        visibility: flat
        indirect: flat
        environment: flat
        specular_at: wp.array(dtype=wp.int32)

    @wp.func_native(_written_for(_TEXT["forward"], dtype, on_cuda))
    def shade_surfel(surfel: wp.int32, given: Inputs, out: flat): ...

    @wp.func_native(_written_for(_TEXT["backward"], dtype, on_cuda))
    def pull_surfel(
        surfel: wp.int32,
        given: Inputs,
        pull: flat,
        wants_incident: wp.int32,
        wants_environment: wp.int32,
        grad_normal: flat,
        grad_albedo: flat,
        grad_roughness: flat,
        grad_visibility: flat,
        grad_indirect: flat,
        grad_environment: flat,
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(begin: wp.int32, given: Inputs, out: flat):
        shade_surfel(begin + wp.tid(), given, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32,
        given: Inputs,
        pull: flat,
        wants_incident: wp.int32,
        wants_environment: wp.int32,
        grad_normal: flat,
        grad_albedo: flat,
        grad_roughness: flat,
        grad_visibility: flat,
        grad_indirect: flat,
        grad_environment: flat,
    ):
        pull_surfel(
            begin + wp.tid(), given, pull, wants_incident, wants_environment,
            grad_normal, grad_albedo, grad_roughness, grad_visibility, grad_indirect, grad_environment,
        )  # fmt: skip

    return SimpleNamespace(Inputs=Inputs, forward=forward, backward=backward)


def _written_for(snippet: str, dtype: torch.dtype, on_cuda: bool) -> str:
    words = {
        "SAMPLES_IN_A_BLOCK": str(1 if on_cuda else LANES_ON_CPU),
        "ATAN_TERMS": str(ATAN_TERMS[dtype]),
        "EXP_TERMS": str(EXP_TERMS[dtype]),
        "F0": repr(FRESNEL_NORMAL),
        "TEXEL": str(TEXEL),
    }
    return native_text(snippet, dtype, on_cuda, words)
