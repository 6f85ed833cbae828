"""Kernels that project surfels into a camera: their records, and bounds on the screen; some surfels an item.

A record is a surfel as a homography of pixel rays (see ``rasterize_source``). With t = centre - eye it consists of
offset = n . t, m_u = offset axis_u - (axis_u . t) n and m_v likewise; n, m_u and m_v are in camera axes.

``seen_kernels`` begin with raw parameters, and also evaluate the harmonics: what frames, footprints, supports and
radiance are to a view, in one launch. Bounds are computed in float64: far from the origin the rounding errors of
float32 are as large as a pixel.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ..lanes import LANES, exponential_words, logarithm_words
from ..native_text import native_file, native_text
from ..runtime import ITEMWISE, scalar_type, start_warp
from ..surfel.footprint_source import FOOTPRINT, FOOTPRINT_WORDS, FRAME
from ..surfel.harmonics_source import HARMONICS
from ..surfel.support_source import REGULAR, SUPPORT, SUPPORT_WORDS
from .rasterize_source import TILE

_TEXT = native_file(
    __package__, "projection.inl", lanes=LANES, frame=FRAME, footprint=FOOTPRINT, support=SUPPORT, harmonics=HARMONICS
)


def surfels_an_item(on_cuda: bool) -> int:
    """Number of surfels that one item of the kernels projects."""
    return 1 if on_cuda else 128


def _written_for(part: str, dtype: torch.dtype, on_cuda: bool) -> str:
    words = {
        **logarithm_words(dtype),
        **exponential_words(dtype),
        "SURFELS_A_VECTOR": "1" if on_cuda else "16",
        "SURFELS_AN_ITEM": str(surfels_an_item(on_cuda)),
        "TILE": str(TILE),
        "REGULAR": str(REGULAR),
        **FOOTPRINT_WORDS,
        **SUPPORT_WORDS,
    }
    return native_text(_TEXT[part], dtype, on_cuda, words)


@cache
def geometry_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type, from a ``SplatGeometry``; all arrays are flat.

    ``pose``: camera to world. ``lens``: fx, fy, cx, cy. ``size``: width and height of the image.
    """
    start_warp()
    flat, integers, doubles = (wp.array(dtype=each) for each in (scalar_type(dtype), wp.int32, wp.float64))
    kinds, flags = wp.array(dtype=wp.uint8), wp.array(dtype=wp.bool)

    @wp.func_native(_written_for("geometry_forward", dtype, on_cuda))
    def project(
        item: wp.int32, surfels: wp.int32, pose: flat, lens: wp.vec4d, size: wp.vec2i,
        centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat,
        out_records: flat, out_tiles: integers, out_depth: doubles, out_kind: kinds, out_touched: flags,
    ): ...  # fmt: skip

    @wp.func_native(_written_for("geometry_backward", dtype, on_cuda))
    def pull_back(
        item: wp.int32, surfels: wp.int32, pose: flat,
        centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, pull: flat,
        to_centre: flat, to_u: flat, to_v: flat, to_normal: flat, to_opacity: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, surfels: wp.int32, pose: flat, lens: wp.vec4d, size: wp.vec2i,
        centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat,
        out_records: flat, out_tiles: integers, out_depth: doubles, out_kind: kinds, out_touched: flags,
    ):  # fmt: skip
        project(
            begin + wp.tid(), surfels, pose, lens, size, centre, axis_u, axis_v, normal, opacity,
            out_records, out_tiles, out_depth, out_kind, out_touched,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, surfels: wp.int32, pose: flat,
        centre: flat, axis_u: flat, axis_v: flat, normal: flat, opacity: flat, pull: flat,
        to_centre: flat, to_u: flat, to_v: flat, to_normal: flat, to_opacity: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), surfels, pose, centre, axis_u, axis_v, normal, opacity, pull,
            to_centre, to_u, to_v, to_normal, to_opacity,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)


@cache
def seen_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type, from raw parameters; all arrays are flat.

    ``size_of_pixel``: side of a pixel at depth 1, world units. ``coefficients``: number of harmonics; 0 leaves the
    radiance out. ``shown_only``: whether the radiance of surfels beside the image may be zero. ``pulled``: a bit for
    each of the pulls that are given.
    """
    start_warp()
    scalar = scalar_type(dtype)
    flat, integers, doubles = (wp.array(dtype=each) for each in (scalar, wp.int32, wp.float64))
    kinds, flags = wp.array(dtype=wp.uint8), wp.array(dtype=wp.bool)

    @wp.func_native(_written_for("raw_forward", dtype, on_cuda))
    def project(
        item: wp.int32, surfels: wp.int32, pose: flat, size_of_pixel: scalar, lens: wp.vec4d, size: wp.vec2i,
        coefficients: wp.int32, shown_only: wp.int32,
        centre: flat, rotation: flat, log_scale: flat, opacity_logit: flat, sh: flat,
        out_records: flat, out_normal: flat, out_radiance: flat, out_sent: flat,
        out_tiles: integers, out_depth: doubles, out_kind: kinds, out_touched: flags,
    ): ...  # fmt: skip

    @wp.func_native(_written_for("raw_backward", dtype, on_cuda))
    def pull_back(
        item: wp.int32, surfels: wp.int32, pose: flat, size_of_pixel: scalar, coefficients: wp.int32, pulled: wp.int32,
        centre: flat, rotation: flat, log_scale: flat, opacity_logit: flat, sh: flat,
        pull_records: flat, pull_normal: flat, pull_radiance: flat, pull_sent: flat,
        to_centres: flat, to_rotations: flat, to_log_scales: flat, to_logits: flat, to_sh: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def forward(
        begin: wp.int32, surfels: wp.int32, pose: flat, size_of_pixel: scalar, lens: wp.vec4d, size: wp.vec2i,
        coefficients: wp.int32, shown_only: wp.int32,
        centre: flat, rotation: flat, log_scale: flat, opacity_logit: flat, sh: flat,
        out_records: flat, out_normal: flat, out_radiance: flat, out_sent: flat,
        out_tiles: integers, out_depth: doubles, out_kind: kinds, out_touched: flags,
    ):  # fmt: skip
        project(
            begin + wp.tid(), surfels, pose, size_of_pixel, lens, size, coefficients, shown_only,
            centre, rotation, log_scale, opacity_logit, sh,
            out_records, out_normal, out_radiance, out_sent, out_tiles, out_depth, out_kind, out_touched,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=ITEMWISE)
    def backward(
        begin: wp.int32, surfels: wp.int32, pose: flat, size_of_pixel: scalar, coefficients: wp.int32, pulled: wp.int32,
        centre: flat, rotation: flat, log_scale: flat, opacity_logit: flat, sh: flat,
        pull_records: flat, pull_normal: flat, pull_radiance: flat, pull_sent: flat,
        to_centres: flat, to_rotations: flat, to_log_scales: flat, to_logits: flat, to_sh: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), surfels, pose, size_of_pixel, coefficients, pulled,
            centre, rotation, log_scale, opacity_logit, sh,
            pull_records, pull_normal, pull_radiance, pull_sent,
            to_centres, to_rotations, to_log_scales, to_logits, to_sh,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward)
