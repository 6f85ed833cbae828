"""Kernels that blend the hits of rays, forward and backward.

Both passes read a stored list of hits, so the backward pass does not traverse the tree again. They are native snippets
that prefetch the data of later hits and rays: surfels, gradient sums and outputs are scattered in memory, and a ray's
arithmetic is short beside the memory latency (measured on M: forward 1.8 times as fast).
"""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA
from ..surfel.harmonics_source import HARMONICS

_TEXT = native_file(__package__, "trace.inl", lanes=LANES, harmonics=HARMONICS)

RAYS_OF_A_RUN = 32
"""Rays of an item on the CPU: for each item Warp copies the kernel's arguments, a kilobyte, twice."""


def rays_of_a_run(on_cuda: bool) -> int:
    """Rays of an item: one on CUDA."""
    return 1 if on_cuda else RAYS_OF_A_RUN


@cache
def trace_kernels(dtype: torch.dtype, on_cuda: bool) -> SimpleNamespace:
    """Kernels ``forward`` and ``backward`` for float32 or float64, and the struct ``Hits`` that both take.

    All arrays are flat; ``coefficients``: number of harmonics; ``channels``: number of features; ``surface``: 16
    numbers a surfel, centre and opacity, then each axis and the normal with a number that does not count. ``out_lit``:
    the colour of every hit, three numbers each, for the backward pass; none if it is empty.
    """
    start_warp()
    scalar = scalar_type(dtype)
    words = {"MAX_ALPHA": str(MAX_ALPHA), "RUN": str(rays_of_a_run(on_cuda))}
    forward_text, backward_text = (native_text(_TEXT[part], dtype, on_cuda, words) for part in ("forward", "backward"))

    @wp.struct
    class Hits:
        ray: wp.array(dtype=wp.int32)
        origin: wp.array(dtype=scalar)
        direction: wp.array(dtype=scalar)
        begin: wp.array(dtype=wp.int32)
        surfel: wp.array(dtype=wp.int32)
        depth: wp.array(dtype=scalar)
        alpha: wp.array(dtype=scalar)
        surface: wp.array(dtype=scalar)
        sh: wp.array(dtype=scalar)
        features: wp.array(dtype=scalar)
        coefficients: wp.int32
        channels: wp.int32

    @wp.func_native(forward_text)
    def blend(
        run: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
        out_lit: wp.array(dtype=scalar),
    ): ...

    @wp.func_native(backward_text)
    def pull_back(
        run: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
        out_lit: wp.array(dtype=scalar),
        pull_colour: wp.array(dtype=scalar),
        pull_scalars: wp.array(dtype=scalar),
        pull_features: wp.array(dtype=scalar),
        grad_origin: wp.array(dtype=scalar),
        grad_surface: wp.array(dtype=scalar),
        grad_sh: wp.array(dtype=scalar),
        grad_features: wp.array(dtype=scalar),
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        first: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
        out_lit: wp.array(dtype=scalar),
    ):
        blend(first + wp.tid(), hits, out_colour, out_scalars, out_features, out_lit)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        first: wp.int32,
        hits: Hits,
        out_colour: wp.array(dtype=scalar),
        out_scalars: wp.array(dtype=scalar),
        out_features: wp.array(dtype=scalar),
        out_lit: wp.array(dtype=scalar),
        pull_colour: wp.array(dtype=scalar),
        pull_scalars: wp.array(dtype=scalar),
        pull_features: wp.array(dtype=scalar),
        grad_origin: wp.array(dtype=scalar),
        grad_surface: wp.array(dtype=scalar),
        grad_sh: wp.array(dtype=scalar),
        grad_features: wp.array(dtype=scalar),
    ):
        pull_back(
            first + wp.tid(), hits, out_colour, out_scalars, out_features, out_lit, pull_colour, pull_scalars,
            pull_features, grad_origin, grad_surface, grad_sh, grad_features,
        )  # fmt: skip

    return SimpleNamespace(Hits=Hits, forward=forward, backward=backward)
