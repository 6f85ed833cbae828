"""K1: rasterize surfels into any number of feature channels in one pass, differentiable in every parameter.

``tile_lists`` computes the exact screen bounds of every support ellipse, and for each tile the list of its surfels in
depth order. ``records_of`` (K11) computes a surfel's homography for one camera; it is differentiable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
import warp as wp
from jaxtyping import Bool, Float, Float64, Int, Int64
from torch import Tensor

from ...instruments import count, require_finite_blend
from ...scene.camera import Camera
from ..arguments import Struct, packed, require_countable
from ..arrangement import as_on_cuda
from ..runtime import WorkerSums, launch_in_parallel
from ..surfel.geometry import SplatGeometry
from ..surfel.support import support_of
from .binning_source import binning_kernels, record_kernels
from .rasterize_source import PIXEL_SUMS, TILE, blend_kernels, pixels_an_item


@dataclass(frozen=True)
class TileLists:
    """The surfels of each tile: ``members[starts[k]:starts[k + 1]]`` for tile k, nearest centre first, ties by
    index."""

    starts: Int[Tensor, " tiles_and_one"]
    """First entry of each tile in ``members``, and at the end the number of entries."""
    members: Int[Tensor, " entries"]
    """Indices of the surfels, tile after tile."""
    touched: Bool[Tensor, " surfels"]
    """Whether the surfel's bounds intersect the image."""


@dataclass(frozen=True)
class Raster:
    """Surfels blended in each pixel with weights w_i, on a background of zero; values are multiplied by coverage."""

    features: Float[Tensor, "height width channels"]
    """sum_i w_i f_i."""
    alpha: Float[Tensor, "height width"]
    """Coverage sum_i w_i."""
    depth: Float[Tensor, "height width"]
    """sum_i w_i z_i with z-depths z_i in world units."""
    distortion: Float[Tensor, "height width"]
    """sum_{i<j} w_i w_j ((z_i - z_j) / depth_unit)^2."""
    touched: Bool[Tensor, " surfels"]
    """Whether the surfel's bounds intersect the image."""


@dataclass(frozen=True)
class Projection:
    """Surfels projected into one camera, which can be blended any number of times; see ``project``."""

    camera: Camera
    """The camera."""
    lists: TileLists
    """The surfels of each tile."""
    records: Float[Tensor, "surfels numbers"]
    """The surfels' homographies (see ``records_of``)."""


def project(camera: Camera, geometry: SplatGeometry) -> Projection:
    """Sort surfels into the tiles of an image, by the depth of their centres (as in 2DGS; ties by index).

    Surfels are skipped if they are degenerate (not finite or without extent), fainter than ALPHA_THRESHOLD, face away,
    or lie behind the camera.
    """
    camera = camera.to(geometry.centre.device, geometry.centre.dtype)
    return Projection(camera, tile_lists(camera, geometry), records_of(camera, geometry))


def blend(
    seen: Projection,
    features: Float[Tensor, "surfels channels"],
    depth_unit: float,
    detached: Sequence[slice] = (),
) -> Raster:
    """Blend surfels front to back.

    Gradients flow from all images to the projected geometry and to ``features``. Raises NumericalFailure if a surfel in
    view has a feature that is not finite.

    Args:
        seen: Projected surfels.
        features: Values of each surfel.
        depth_unit: Unit of depth in the distortion, world units, which makes it independent of the scene's scale.
        detached: Ranges of channels whose images give gradient to their features only, and none to the geometry.
    """
    camera = seen.camera
    images, sums = _Blend.apply(camera, seen.lists, depth_unit, detached, seen.records, features)
    require_finite_blend("blended features", images, {"features": features})
    shape = (camera.height, camera.width)
    alpha, depth, distortion = (sums[:, column].view(shape) for column in range(3))
    return Raster(images.view(*shape, -1), alpha, depth, distortion, seen.lists.touched)


def rasterize(
    camera: Camera,
    geometry: SplatGeometry,
    features: Float[Tensor, "surfels channels"],
    depth_unit: float,
    detached: Sequence[slice] = (),
) -> Raster:
    """Project surfels into a camera and blend them; see ``project`` and ``blend``."""
    return blend(project(camera, geometry), features, depth_unit, detached)


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, camera: Camera, lists: TileLists, depth_unit: float, detached: Sequence[slice], *splats: Tensor
    ) -> tuple[Tensor, Tensor]:
        splats = tuple(value.detach().contiguous() for value in splats)
        like, channels = splats[0], splats[-1].shape[1]
        kernels = blend_kernels(like.dtype, channels, as_on_cuda(like.device))
        pixels = camera.width * camera.height
        images = like.new_empty(pixels, channels)
        sums = like.new_empty(pixels, PIXEL_SUMS)
        ends, blended = (torch.empty(pixels, dtype=torch.int32, device=like.device) for _ in range(2))
        arguments = _arguments(kernels, camera, lists, depth_unit, splats)
        outputs = [images, sums, ends, blended]
        launch_in_parallel(kernels.forward, _items(camera, like.device), like.device, lambda _: [*arguments, *outputs])
        pairs = blended.sum()
        count(blended_pairs=pairs, bytes_read=pairs * sum(value[:1].numel() for value in splats) * like.element_size())
        attached = images
        if detached:
            # The gradient to a feature does not depend on its value, but the gradient to a weight is a product with it.
            attached, splats = _zeroed(images, detached), (splats[0], _zeroed(splats[1], detached))
            arguments = _arguments(kernels, camera, lists, depth_unit, splats)
        ctx.camera, ctx.arguments = camera, arguments
        ctx.save_for_backward(attached, sums, ends, *splats)
        return images, sums

    @staticmethod
    def backward(ctx: Any, grad_images: Tensor, grad_sums: Tensor) -> Any:
        images, sums, ends, *splats = ctx.saved_tensors
        kernels = blend_kernels(images.dtype, images.shape[1], as_on_cuda(images.device))
        gradients = WorkerSums(splats, images.device)
        saved = [images, sums, ends, grad_images.contiguous(), grad_sums.contiguous()]
        launch_in_parallel(
            kernels.backward,
            _items(ctx.camera, images.device),
            images.device,
            lambda worker: [*ctx.arguments, *saved, *gradients.of(worker)],
        )
        return None, None, None, None, *gradients.total()


def _zeroed(values: Float[Tensor, "rows channels"], channels: Sequence[slice]) -> Float[Tensor, "rows channels"]:
    """A copy of the values with zeros in some channels."""
    values = values.clone()
    for each in channels:
        values[:, each] = 0
    return values


def _arguments(kernels: Any, camera: Camera, lists: TileLists, depth_unit: float, splats: Any) -> list[Struct]:
    image = Struct(
        kernels.Image,
        width=camera.width,
        height=camera.height,
        tiles_across=-(-camera.width // TILE),
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        depth_unit=depth_unit,
    )
    records, features = splats
    return [
        image,
        Struct(kernels.Splats, starts=lists.starts, members=lists.members, records=records, features=features),
    ]


def _items(camera: Camera, device: torch.device) -> int:
    """Number of items of the blending kernels, for whole tiles."""
    tiles = -(-camera.width // TILE) * -(-camera.height // TILE)
    return tiles * TILE * TILE // pixels_an_item(as_on_cuda(device))


def records_of(camera: Camera, geometry: SplatGeometry) -> Float[Tensor, "surfels 12"]:
    """The surfels' records: homographies of pixel rays, opacity and squared support radius (see ``rasterize_source``).

    Gradients flow to all fields of the geometry; the support radius is a constant. ``camera`` has to be on the surfels'
    device.
    """
    return _Records.apply(camera, *(getattr(geometry, field.name) for field in fields(geometry)))


class _Records(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, camera: Camera, *surfels: Tensor) -> Tensor:
        kernels, given = record_kernels(surfels[0].dtype), [value.detach().contiguous() for value in surfels]
        out = given[0].new_empty(len(given[0]), 12)
        ctx.arguments = [camera.camera_to_world.contiguous(), *given]
        arguments = [*ctx.arguments, out]
        launch_in_parallel(kernels.forward, len(out), out.device, lambda _: arguments)
        ctx.save_for_backward(*given)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[None, Tensor, Tensor, Tensor, Tensor, Tensor]:
        to_centre, to_u, to_v, to_normal, to_opacity = map(torch.empty_like, ctx.saved_tensors)
        out = to_centre, to_u, to_v, to_normal, to_opacity
        arguments = [*ctx.arguments, pull.contiguous(), *out]
        launch_in_parallel(record_kernels(pull.dtype).backward, len(pull), pull.device, lambda _: arguments)
        return None, *out


@torch.no_grad()
def tile_lists(camera: Camera, geometry: SplatGeometry) -> TileLists:
    """Sort the surfels into tiles of TILE x TILE pixels; tiles are numbered row by row.

    Depths are compared in float64. In a scene far from the origin, centres on a common lattice have depths that differ
    only by float32's rounding, and each pair that the rounding swaps changes the image (measured 1e6 units from the
    origin: by 0.018 in float32, by nothing in float64).
    """
    tiles, counts, depth = _bounds(camera, geometry)
    touched = counts > 0
    entries = int(counts.sum())
    require_countable(entries, "pairs of a surfel and a tile", "Render a smaller image, or fewer surfels.")
    drawn = torch.nonzero(touched)[:, 0]
    nearest_first = drawn[_in_order(depth[drawn]).argsort(stable=True)]
    gather = sorted_lists if as_on_cuda(depth.device) else counted_lists
    starts, members = gather(camera, tiles, nearest_first, entries)
    return TileLists(starts, members, touched)


def _in_order(numbers: Float64[Tensor, " numbers"]) -> Int64[Tensor, " numbers"]:
    """Integers in the order of the numbers: their bits, inverted for negative numbers.

    Integers are sorted by a radix sort, which for 100,000 of them takes a quarter of the time.
    """
    bits = numbers.view(torch.int64)
    return bits ^ ((bits >> 63) & torch.iinfo(torch.int64).max)


def _bounds(camera: Camera, geometry: SplatGeometry) -> tuple[Tensor, Tensor, Tensor]:
    """Each surfel's first and last tile [surfels, 4] (column, row), its number of tiles, and its centre's z-depth."""
    centre = geometry.centre
    kernels = binning_kernels(centre.dtype)
    window = Struct(
        kernels.Window,
        pose=torch.cat([camera.centre[None], camera.axes.mT]).double().contiguous(),
        focal=(camera.fx, camera.fy),
        offset=(camera.cx, camera.cy),
        width=camera.width,
        height=camera.height,
    )
    tiles = torch.empty(len(centre), 4, dtype=torch.int32, device=centre.device)
    counts = torch.empty(len(centre), dtype=torch.int64, device=centre.device)
    depth = torch.empty(len(centre), dtype=torch.float64, device=centre.device)
    vectors = [value.contiguous() for value in (centre, geometry.axis_u, geometry.axis_v, geometry.normal)]
    support = support_of(geometry).counted()
    arguments = [
        window, *vectors, support.radius, support.can_be_hit, tiles, counts, depth,
    ]  # fmt: skip
    launch_in_parallel(kernels.bound, len(centre), centre.device, lambda _: arguments)
    return tiles, counts, depth


def counted_lists(
    camera: Camera, tiles: Int[Tensor, "surfels 4"], nearest_first: Int[Tensor, " drawn"], entries: int
) -> tuple[Int[Tensor, " tiles_and_one"], Int[Tensor, " entries"]]:
    """``starts`` and ``members`` by a counting sort in one thread, for the CPU."""
    across, count = _grid(camera)
    starts = torch.zeros(count + 1, dtype=torch.int32)
    members = torch.empty(entries, dtype=torch.int32)
    listed = binning_kernels(torch.float32).listed
    arguments = packed(listed, [across, count, nearest_first, tiles, starts, members])
    wp.launch(listed, dim=1, inputs=arguments, device="cpu")
    return starts, members


def sorted_lists(
    camera: Camera, tiles: Int[Tensor, "surfels 4"], nearest_first: Int[Tensor, " drawn"], entries: int
) -> tuple[Int[Tensor, " tiles_and_one"], Int[Tensor, " entries"]]:
    """``starts`` and ``members`` by a stable sort of all pairs, for CUDA."""
    across, count = _grid(camera)
    first, last = tiles[nearest_first].view(-1, 2, 2).unbind(1)
    counts = (last - first + 1).prod(-1)
    begins = counts.cumsum(0) - counts
    tile, member = (torch.empty(entries, dtype=torch.int32, device=tiles.device) for _ in range(2))
    write, arguments = binning_kernels(torch.float32).entries, [across, nearest_first, begins, tiles, tile, member]
    launch_in_parallel(write, len(nearest_first), tiles.device, lambda _: arguments)
    # Pairs come in depth order; a stable sort by tile keeps that order within each tile.
    tile, order = tile.sort(stable=True)
    starts = torch.searchsorted(tile, torch.arange(count + 1, dtype=torch.int32, device=tile.device), out_int32=True)
    return starts, member[order]


def _grid(camera: Camera) -> tuple[int, int]:
    """Number of tiles in a row, and in the whole image."""
    across = -(-camera.width // TILE)
    return across, across * -(-camera.height // TILE)
