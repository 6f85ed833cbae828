"""K1: blend projected surfels into any number of feature channels in one pass, differentiable in every parameter.

A surfel is a homography from the pixel ray d (camera axes, z-depth 1) to its plane: with
n' = normal, m_u = (axis_u . (o - c)) n' + (n' . (c - o)) axis_u, all in camera axes,

    t = offset / (n' . d),   u = (m_u . d) / (n' . d),   v = (m_v . d) / (n' . d),

so a hit costs three dot products; ``projection`` applies the chain rule to centre, axes and normal.

The item of both passes is a tile on the CPU: its pixels are the lanes of vectors, and a surfel has weight zero in lanes
that it does not cover. Arranged for CUDA, an item is a pixel: the same text with one lane.

There, half a warp has a tile. In the backward pass its lanes go through the tile's list together, sum the gradients of
each entry by shuffles, and store the sums in the entry's slot. A second kernel adds each surfel's slots in a fixed
order. So gradients need no atomics, and repeat bit for bit.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Bool, Float
from torch import Tensor

from ...instruments import amounts_in, count, current, require_finite_blend
from ...scene.camera import Camera
from ..arguments import lens_of
from ..arrangement import an_item, as_on_cuda, items_of
from ..lanes import LANES, bell_words
from ..native_kernel import INTEGERS, LONGS, flat, native_file, native_kernel
from ..runtime import ITEMWISE, NATIVE, WorkerSums, launch_in_parallel, scalar_type
from ..surfel.geometry import MAX_ALPHA, RASTER_TRANSMITTANCE_STOP, SplatGeometry
from .binning import TILE, Slots
from .projection import RECORD, Projection, project

RASTERIZE = native_file(__package__, "rasterize.inl", LANES)

PLANES = 4
"""Images beside the channels: alpha, depth, mean depth, distortion."""

PIXEL_SUMS = 5
"""Sums stored for each pixel for the backward pass: sum w, sum w z, distortion, sum w m, sum w m^2, with
m = z / depth_unit."""


@dataclass(frozen=True)
class Raster:
    """Surfels blended in each pixel with weights w_i, on a background of zero; values are multiplied by coverage."""

    images: tuple[Float[Tensor, "height width _"], ...]
    """sum_i w_i f_i, for each of the blended features."""
    alpha: Float[Tensor, "height width"]
    """Coverage sum_i w_i."""
    depth: Float[Tensor, "height width"]
    """sum_i w_i z_i with z-depths z_i in world units."""
    mean_depth: Float[Tensor, "height width"]
    """``depth`` over ``alpha``, world units; 0 in an empty pixel."""
    distortion: Float[Tensor, "height width"]
    """sum_{i<j} w_i w_j ((z_i - z_j) / depth_unit)^2."""
    touched: Bool[Tensor, " surfels"]
    """Whether the surfel's bounds intersect the image."""

    @property
    def features(self) -> Float[Tensor, "height width channels"]:
        """The first of ``images``."""
        return self.images[0]


def blend_together(
    seen: Projection,
    features: Sequence[Float[Tensor, "surfels _"]],
    depth_unit: float,
    detached: Collection[int] = (),
) -> Raster:
    """Blend surfels front to back, several features in one pass.

    Gradients flow from all images to the projected geometry and to ``features``. Raises NumericalFailure if a surfel in
    view has a feature that is not finite.

    Args:
        seen: Projected surfels.
        features: Values of each surfel.
        depth_unit: Unit of depth in the distortion, world units, which makes it independent of the scene's scale.
        detached: Indices of features whose images give gradient to them only, and none to the geometry.
    """
    alpha, depth, mean_depth, distortion, *images = _Blend.apply(seen, depth_unit, detached, seen.records, *features)
    for image, values in zip(images, features, strict=True):
        require_finite_blend("blended features", image, {"features": values})
    return Raster(tuple(images), alpha, depth, mean_depth, distortion, seen.bounds.touched)


def blend(seen: Projection, features: Float[Tensor, "surfels channels"], depth_unit: float) -> Raster:
    """Blend one tensor of features; see ``blend_together``."""
    return blend_together(seen, [features], depth_unit)


def rasterize(
    camera: Camera, geometry: SplatGeometry, features: Float[Tensor, "surfels channels"], depth_unit: float
) -> Raster:
    """Project surfels into a camera and blend them; see ``project`` and ``blend``."""
    return blend(project(camera, geometry), features, depth_unit)


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, seen: Projection, depth_unit: float, detached: Collection[int], records: Tensor, *features: Tensor
    ) -> tuple[Tensor, ...]:
        camera, records, together = seen.camera, records.contiguous(), _joined(features)
        kernels = blend_kernels(records.dtype, together.shape[1], as_on_cuda(records.device))
        shape = camera.height, camera.width
        planes = [records.new_empty(shape) for _ in range(PLANES)]
        images = [records.new_empty(*shape, values.shape[1]) for values in features]
        sums, ends = records.new_empty(*shape, PIXEL_SUMS), seen.lists.starts.new_empty(shape)
        tiles = -(-camera.width // TILE) * -(-camera.height // TILE)
        items = items_of(tiles * TILE * TILE, records.device, TILE * TILE)
        blended = ends.new_empty(items)
        widths = [image.shape[-1] for image in images]
        strides = kernels.Strides(*(width for width in widths for _ in range(width)))
        size = wp.vec3i(camera.width, camera.height, -(-camera.width // TILE))
        view = [lens_of(camera), size, depth_unit, seen.lists.starts, seen.lists.members]
        addresses = _planes(kernels.Planes, images, widths, planes)
        arguments = [*view, records, together, addresses, strides, sums, ends, blended]
        launch_in_parallel(kernels.forward, items, records.device, arguments)
        if current() is not None:
            (pairs,) = amounts_in(blended.sum(0, keepdim=True))
            read = (records.shape[1] + together.shape[1]) * records.element_size()
            count(blended_pairs=pairs, bytes_read=pairs * read)
        if detached:
            # The gradient to a feature does not depend on its value, but the gradient to a weight is a product with it.
            kept = (torch.zeros_like(each) if k in detached else each for k, each in enumerate(features))
            together = _joined(tuple(kept))
        ctx.kernels, ctx.view, ctx.strides, ctx.items, ctx.detached = kernels, view, strides, items, detached
        ctx.slots = seen.lists.slots
        ctx.save_for_backward(records, together, sums, ends, *images)
        ctx.set_materialize_grads(False)
        return *planes, *images

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor | None) -> Any:
        records, together, sums, ends, *images = ctx.saved_tensors
        device, kind = records.device, ctx.kernels.Planes
        kept = [None if index in ctx.detached else image for index, image in enumerate(images)]
        widths = [image.shape[-1] for image in images]
        given = [pull if pull is None else pull.contiguous() for pull in pulls]
        planes = _planes(kind, kept, widths, [None] * PLANES)
        pulls_of = _planes(kind, given[PLANES:], widths, given[:PLANES])
        arguments = [*ctx.view, records, together, planes, ctx.strides, pulls_of, sums, ends]
        gradients = WorkerSums([records, together], device)
        if ctx.slots is None:
            launch_in_parallel(ctx.kernels.backward, ctx.items, device, arguments, gradients)
        else:
            of_entries = records.new_zeros(len(ctx.slots.of_entries), RECORD - 1 + together.shape[1])
            arguments += [ctx.slots.of_entries, of_entries]
            launch_in_parallel(ctx.kernels.backward, ctx.items, device, arguments)
            _gather(ctx.slots, of_entries, gradients)
        to_records, to_features = gradients.total()
        return None, None, None, to_records, *(to_features.split(widths, -1) if len(widths) > 1 else [to_features])


def _gather(slots: Slots, of_entries: Float[Tensor, "slots gradients"], to: WorkerSums) -> None:
    """Add up the gradients that lie in the slots of each surfel."""
    gradients = of_entries.shape[1]
    kernel = gather_kernel(of_entries.dtype, gradients - (RECORD - 1))
    arguments = [slots.surfels, slots.ends, of_entries]
    launch_in_parallel(kernel, len(slots.surfels) * gradients, of_entries.device, arguments, to)


def _joined(features: tuple[Tensor, ...]) -> Tensor:
    return torch.cat(features, -1) if len(features) > 1 else features[0].contiguous()


def _planes(kind: Any, images: Sequence[Tensor | None], widths: Sequence[int], others: Sequence[Tensor | None]) -> Any:
    """The addresses of all channels, and of ``others``, the PLANES; 0 where there is none.

    Each image is contiguous; together they have all channels. ``widths``: number of channels of each image.
    """
    channels = (
        0 if image is None else image.data_ptr() + channel * image.element_size()
        for image, width in zip(images, widths, strict=True)
        for channel in range(width)
    )
    return kind(*channels, *(0 if plane is None else plane.data_ptr() for plane in others))


class BlendKernels(NamedTuple):
    """The kernels for a number of feature channels, and the types of two of their parameters."""

    forward: wp.Kernel
    backward: wp.Kernel
    Planes: Any
    """An address for each channel and each of the PLANES, so that images need not lie together."""
    Strides: Any
    """Numbers from pixel to pixel of each channel."""


@cache
def blend_kernels(dtype: torch.dtype, channels: int, on_cuda: bool) -> BlendKernels:
    """The kernels for a scalar type, a number of feature channels and a division of work.

    ``size``: width and height of the image, and tiles in a row.
    """
    pixels, gradients = an_item(on_cuda, TILE * TILE), RECORD - 1 + channels
    words = {
        "PIXELS_AN_ITEM": pixels,
        "TILE": TILE,
        "RECORD": RECORD,
        "CHANNELS": channels,
        "GRADIENTS": gradients,
        "SUMS": PIXEL_SUMS,
        "MAX_ALPHA": MAX_ALPHA,
        "STOP": RASTER_TRANSMITTANCE_STOP,
        "ROWS": -(-gradients // TILE**2) * TILE**2,  # the extra gradients are zero
        **bell_words(dtype),
    }
    make, arrays = partial(native_kernel, RASTERIZE, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    Planes, Strides = wp.types.vector(channels + PLANES, wp.uint64), wp.types.vector(channels, wp.int32)
    given = (
        (wp.vec4d, "lens"),
        (wp.vec3i, "size"),
        (scalar_type(dtype), "depth_unit"),
        (INTEGERS, "starts members"),
        (arrays, "records features"),
        (Planes, "planes"),
        (Strides, "strides"),
    )
    out = (arrays, "out_sums"), (INTEGERS, "out_end out_blended")
    to = [(LONGS, "slot_of"), (arrays, "slots")] if on_cuda else [(arrays, "grad_records grad_features")]
    pulls = (Planes, "pulls"), (arrays, "sums"), (INTEGERS, "ends"), *to
    forward, backward = make("forward", "item", *given, *out), make("backward", "item", *given, *pulls)
    return BlendKernels(forward, backward, Planes, Strides)


@cache
def gather_kernel(dtype: torch.dtype, channels: int) -> wp.Kernel:
    """The kernel that adds up the slots of surfels in view; an item is one gradient of one surfel."""
    words = {"GRADIENTS": RECORD - 1 + channels, "RECORD": RECORD, "CHANNELS": channels}
    parameters = (LONGS, "surfels ends"), (flat(dtype), "slots grad_records grad_features")
    return native_kernel(RASTERIZE, dtype, ITEMWISE, "gather", "item", *parameters, words=words)
