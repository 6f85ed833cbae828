"""Kernels that find the hits of rays: gather the hits of each ray in order, then pack the lists of all rays into one.

Gathering is a native snippet (a Warp version of the same traversal measured a third of its speed).
"""

from functools import cache
from types import SimpleNamespace

import torch
import warp as wp

from ..lanes import LANES, bell_words
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.geometry import MAX_ALPHA

_TEXT = native_file(__package__, "hits.inl", lanes=LANES)

TOGETHER = 64
"""Most rays that go through the tree together on the CPU: the bits of an integer."""

MOST_NODES = 4096
"""Largest number of nodes, and of leaves, that rays which go together enter; if there are more, each of these rays is
traversed nearest first."""

MOST_MET = 256
"""Most pairs of a ray and a leaf with hits that are kept before the hits are added to those of their rays."""

MOST_HITS = 248
"""Largest number of hits that are sorted together; a ray with more is traversed nearest first."""

FEW_HITS = 32
"""Hits that are sorted without a look at whether the nearer ones let enough light through to the farther ones: as many
as ``put_in_order`` has code of its own for."""

STACK = 96
"""Entries of the traversal stack: 7 (depth - 1) + 1 are needed, so 96 allows 14 levels (8^14 leaves)."""

BUFFER = 32
"""Hits of a ray in one round of nearest-first traversal; fewer measured slower, because more rounds are needed."""

FINISHED = -1.0
"""Sentinel transmittance: the ray needs no further round."""

NO_SURFEL = 2**31 - 1
"""Surfel at which the first round of a ray starts: hits exactly at its starting depth are skipped."""


@cache
def hit_kernels(dtype: torch.dtype, on_cuda: bool) -> SimpleNamespace:
    """Kernels ``code``, ``gather`` and ``pack`` for float32 or float64, and the vector type that they take."""
    start_warp()
    scalar = scalar_type(dtype)
    vector = wp.types.vector(3, scalar)
    sizes = {
        "TOGETHER": TOGETHER,
        "FEW_HITS": FEW_HITS,
        "BUFFER": BUFFER,
        "STACK": STACK,
        "MOST_NODES": MOST_NODES,
        "MOST_HITS": MOST_HITS,
        "MOST_MET": MOST_MET,
    }
    sizes |= {"NO_SURFEL": NO_SURFEL, "FINISHED": FINISHED}
    words = {**{name: str(size) for name, size in sizes.items()}, "MAX_ALPHA": str(MAX_ALPHA), **bell_words(dtype)}

    @wp.func
    def spread(bits: wp.int32):
        """Insert two zeros between any two of nine bits."""
        bits = (bits | (bits << 16)) & 0x030000FF
        bits = (bits | (bits << 8)) & 0x0300F00F
        bits = (bits | (bits << 4)) & 0x030C30C3
        return (bits | (bits << 2)) & 0x09249249

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def code(
        first: wp.int32,
        origin: wp.array(dtype=vector),
        direction: wp.array(dtype=vector),
        low: vector,
        cells: scalar,
        out: wp.array(dtype=wp.int32),
    ):
        ray = first + wp.tid()
        place = (origin[ray] - low) * cells
        towards = direction[ray]
        found = wp.int32(0)
        for axis in range(3):
            cell = wp.clamp(wp.int32(place[axis]), 0, 511)
            found += spread(cell) << axis
            if towards[axis] > scalar(0.0):
                found += 1 << (27 + axis)
        out[ray] = found

    @wp.func_native(native_text(_TEXT["gather"], dtype, on_cuda, words))
    def gather_hits(
        item: wp.int32,
        of_origin: wp.int32,
        rays: wp.array(dtype=wp.int32),
        origins: wp.array(dtype=vector),
        directions: wp.array(dtype=vector),
        starts_t: wp.array(dtype=scalar),
        starts_id: wp.array(dtype=wp.int32),
        starts_rest: wp.array(dtype=scalar),
        backs_t: wp.array(dtype=scalar),
        stop: scalar,
        boxes: wp.array(dtype=scalar),
        children: wp.array(dtype=wp.int32),
        leaves: wp.array(dtype=scalar),
        order: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        hits_alpha: wp.array(dtype=scalar),
        used: wp.array(dtype=wp.int32),
        found_out: wp.array(dtype=wp.int32),
        rest_out: wp.array(dtype=scalar),
        nodes_out: wp.array(dtype=wp.int32),
        leaves_out: wp.array(dtype=wp.int32),
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def gather(
        first: wp.int32,
        of_origin: wp.int32,
        rays: wp.array(dtype=wp.int32),
        origins: wp.array(dtype=vector),
        directions: wp.array(dtype=vector),
        starts_t: wp.array(dtype=scalar),
        starts_id: wp.array(dtype=wp.int32),
        starts_rest: wp.array(dtype=scalar),
        backs_t: wp.array(dtype=scalar),
        stop: scalar,
        boxes: wp.array(dtype=scalar),
        children: wp.array(dtype=wp.int32),
        leaves: wp.array(dtype=scalar),
        order: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        hits_alpha: wp.array(dtype=scalar),
        used: wp.array(dtype=wp.int32),
        found_out: wp.array(dtype=wp.int32),
        rest_out: wp.array(dtype=scalar),
        nodes_out: wp.array(dtype=wp.int32),
        leaves_out: wp.array(dtype=wp.int32),
    ):
        gather_hits(
            first + wp.tid(), of_origin, rays, origins, directions, starts_t, starts_id, starts_rest, backs_t, stop,
            boxes, children, leaves, order, hits_t, hits_id, hits_alpha, used, found_out, rest_out, nodes_out,
            leaves_out,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def pack(
        first: wp.int32,
        found: wp.array(dtype=wp.int32),
        begin: wp.array(dtype=wp.int32),
        target: wp.array(dtype=wp.int32),
        hits_t: wp.array(dtype=scalar),
        hits_id: wp.array(dtype=wp.int32),
        hits_alpha: wp.array(dtype=scalar),
        depth: wp.array(dtype=scalar),
        surfel: wp.array(dtype=wp.int32),
        alpha: wp.array(dtype=scalar),
    ):
        slot = first + wp.tid()
        for step in range(found[slot]):
            depth[target[slot] + step] = hits_t[begin[slot] + step]
            surfel[target[slot] + step] = hits_id[begin[slot] + step]
            alpha[target[slot] + step] = hits_alpha[begin[slot] + step]

    return SimpleNamespace(code=code, gather=gather, pack=pack, vector=vector)
