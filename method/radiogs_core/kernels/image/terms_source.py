"""Kernels for the terms that each pixel has of its own in a step's image losses: an item is a block of one row.

The forward kernel also prepares what is compared with neighbours: images in display colour, and masked maps.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import torch
import warp as wp

from ...scene.colour import LINEAR_KNEE
from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from .blocks import BLOCK, columns_of
from .depth_map_source import PLANES
from .display_source import DISPLAY, power_words

_TEXT = native_file(__package__, "terms.inl", blocks=BLOCK, lanes=LANES, display=DISPLAY)

MASK_CONFIDENCE = 1e-6
"""Coverage is kept this far from 0 and 1 inside the logarithm: one wrong pixel costs at most 13.8 nats."""

MOST = 8
"""Largest number of images, and of maps."""

ENCODINGS = {"premultiplied": 0, "straight": 1, "display": 2}
"""Numbers of the encodings: the first two are those of ``display.displayed``; "display": radiance is display sRGB."""


@cache
def term_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` for a scalar type and a division of work; ``columns``: pixels of a block.

    Arrays are flat; images and maps are passed by their ``addresses``, and maps by the ``counts`` of their channels.
    A term that is absent has index -1. ``maps``: the maps with interleaved channels. ``masked``: 1: they are multiplied
    by the mask. ``far``: depth from which distortion counts as that of disparity; 0: nowhere. ``normals``: see
    ``surface_kernel``. ``attached``: bit k: coverage has a gradient by image k.
    """
    start_warp()
    scalar, columns = scalar_type(dtype), columns_of(on_cuda)
    flat = wp.array(dtype=scalar)
    addresses, counts = wp.types.vector(MOST, wp.uint64), wp.types.vector(MOST, wp.int32)
    words = {
        **power_words(dtype),
        **{name: str(place) for name, place in PLANES.items()},
        "ENTRIES": "1", "REACH": "0", "BLOCK_COLUMNS": str(columns),
        "VECTOR_SIZE": "1" if on_cuda else "16", "KNEE": repr(LINEAR_KNEE), "CONFIDENCE": repr(MASK_CONFIDENCE),
        "STRAIGHT": str(ENCODINGS["straight"]), "IN_DISPLAY": str(ENCODINGS["display"]),
    }  # fmt: skip
    forward_text, backward_text = (native_text(_TEXT[part], dtype, on_cuda, words) for part in ("forward", "backward"))

    @wp.func_native(forward_text)
    def prepare(
        item: wp.int32, height: wp.int32, width: wp.int32, encoding: wp.int32, masked: wp.int32,
        mask_term: wp.int32, distortion_term: wp.int32, background: scalar, far: scalar, images: wp.int32,
        map_count: wp.int32, widths: counts, blended: addresses, given_maps: addresses, alpha: flat, depth: flat,
        distortion: flat, mask: flat, encoded: flat, shown: flat, maps: flat, sums: flat,
    ): ...  # fmt: skip

    @wp.func_native(backward_text)
    def pull_back(
        item: wp.int32, height: wp.int32, width: wp.int32, encoding: wp.int32, masked: wp.int32,
        mask_term: wp.int32, distortion_term: wp.int32, normal_term: wp.int32, normal_is_smoothed: wp.int32,
        attached: wp.int32, background: scalar, far: scalar, images: wp.int32, map_count: wp.int32, widths: counts,
        blended: addresses, to_blended: addresses, to_maps: addresses, alpha: flat, depth: flat, mask: flat,
        encoded: flat, normals: flat, of_shown: flat, of_maps: flat, pulls: flat, to_alpha: flat, to_normal: flat,
        to_depth: flat, to_distortion: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, height: wp.int32, width: wp.int32, encoding: wp.int32, masked: wp.int32,
        mask_term: wp.int32, distortion_term: wp.int32, background: scalar, far: scalar, images: wp.int32,
        map_count: wp.int32, widths: counts, blended: addresses, given_maps: addresses, alpha: flat, depth: flat,
        distortion: flat, mask: flat, encoded: flat, shown: flat, maps: flat, sums: flat,
    ):  # fmt: skip
        prepare(
            begin + wp.tid(), height, width, encoding, masked, mask_term, distortion_term, background, far, images,
            map_count, widths, blended, given_maps, alpha, depth, distortion, mask, encoded, shown, maps, sums,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, height: wp.int32, width: wp.int32, encoding: wp.int32, masked: wp.int32,
        mask_term: wp.int32, distortion_term: wp.int32, normal_term: wp.int32, normal_is_smoothed: wp.int32,
        attached: wp.int32, background: scalar, far: scalar, images: wp.int32, map_count: wp.int32, widths: counts,
        blended: addresses, to_blended: addresses, to_maps: addresses, alpha: flat, depth: flat, mask: flat,
        encoded: flat, normals: flat, of_shown: flat, of_maps: flat, pulls: flat, to_alpha: flat, to_normal: flat,
        to_depth: flat, to_distortion: flat,
    ):  # fmt: skip
        pull_back(
            begin + wp.tid(), height, width, encoding, masked, mask_term, distortion_term, normal_term,
            normal_is_smoothed, attached, background, far, images, map_count, widths, blended, to_blended, to_maps,
            alpha, depth, mask, encoded, normals, of_shown, of_maps, pulls, to_alpha, to_normal, to_depth,
            to_distortion,
        )  # fmt: skip

    return SimpleNamespace(forward=forward, backward=backward, addresses=addresses, counts=counts, columns=columns)
