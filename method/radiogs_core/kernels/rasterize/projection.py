"""K11: surfels projected into a camera. Their homographies and bounds on the screen, and each tile's list.

``project`` begins with a geometry, ``project_surfels`` with raw parameters: what a step or a frame needs of surfels for
one camera is one launch, and one more for all gradients.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import torch
import warp as wp
from jaxtyping import Bool, Float, Float64, Int, Int64, UInt8
from torch import Tensor

from ...instruments import fire
from ...scene.camera import Camera
from ..arguments import MOST_ENTRIES, require_countable
from ..arrangement import as_on_cuda
from ..runtime import launch, launch_in_parallel
from ..surfel.geometry import SplatGeometry
from ..surfel.support_source import DEGENERATE, FAINT, SATURABLE
from .binning_source import binning_kernels
from .projection_source import geometry_kernels, seen_kernels, surfels_an_item
from .rasterize_source import RECORD, TILE


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
class Bounds:
    """Where surfels can lie on the screen, without gradient."""

    tiles: Int[Tensor, "surfels 4"]
    """Column and row of the first tile and of the last one; 0, 0, -1, -1 beside the image."""
    depth: Float64[Tensor, " surfels"]
    """z-depth of the centre, world units."""
    kind: UInt8[Tensor, " surfels"]
    """DEGENERATE, FAINT, REGULAR or SATURABLE (see ``support_source``)."""
    touched: Bool[Tensor, " surfels"]
    """Whether the surfel's bounds intersect the image."""


@dataclass(frozen=True)
class Projection:
    """Surfels projected into one camera, which can be blended any number of times; see ``project``."""

    camera: Camera
    """The camera."""
    bounds: Bounds
    """Where the surfels can lie on the screen."""
    records: Float[Tensor, "surfels 12"]
    """The surfels' homographies of pixel rays, opacities and squared support radii (see ``rasterize_source``)."""

    @cached_property
    def lists(self) -> TileLists:
        """The surfels of each tile; they are sorted when they are asked for first, and guards are counted then."""
        return tile_lists(self.camera, self.bounds)


@dataclass(frozen=True)
class ProjectedSurfels(Projection):
    """Surfels projected from their raw parameters; see ``project_surfels``."""

    normal: Float[Tensor, "surfels 3"]
    """Unit normals, in the world."""
    radiance: Float[Tensor, "surfels 3"] | None
    """The surfels' own radiance L_G towards the camera, linear RGB, if it was asked for."""
    sent: Float[Tensor, "surfels 3"] | None
    """The same values as ``radiance``, with gradient to the harmonics only."""


def project(camera: Camera, geometry: SplatGeometry) -> Projection:
    """Project surfels into an image; lists are sorted by the depth of their centres (as in 2DGS; ties by index).

    Surfels are skipped if they are degenerate (not finite or without extent), fainter than ALPHA_THRESHOLD, face away,
    or lie behind the camera. Gradients flow from ``records`` to all fields of the geometry; the support radius is a
    constant.
    """
    camera = camera.to(geometry.centre.device, geometry.centre.dtype)
    values = (getattr(geometry, field.name) for field in fields(geometry))
    records, *bounds = _FromGeometry.apply(camera, *values)
    return Projection(camera, Bounds(*bounds), records)


def project_surfels(
    camera: Camera,
    place: tuple[Float[Tensor, "surfels 3"], Float[Tensor, "surfels 4"]],
    log_scale: Float[Tensor, "surfels 2"],
    opacity_logit: Float[Tensor, " surfels"],
    sh: Float[Tensor, "surfels coefficients 3"] | None,
    shown_only: bool = False,
) -> ProjectedSurfels:
    """Project surfels, widened by the footprint of a pixel (``surfel.footprint.widened``), from raw parameters.

    A surfel's radiance is max(0, SH + 1/2) along the ray from the camera; at the camera's centre there is no ray, and
    no gradient of it. Gradients flow to all parameters; footprints and support radii are constants.

    Args:
        camera: Camera of the image.
        place: Centres in the world, and quaternions (w, x, y, z).
        log_scale: Logarithms of the standard deviations along t_u and t_v, world units.
        opacity_logit: Logits of the peak opacities.
        sh: Harmonics of the radiance; None leaves ``radiance`` and ``sent`` out.
        shown_only: Leave the radiance of surfels beside the image at zero.
    """
    camera = camera.to(log_scale.device, log_scale.dtype)
    records, normal, radiance, sent, *bounds = _FromSurfels.apply(
        camera, shown_only, *place, log_scale, opacity_logit, sh
    )
    return ProjectedSurfels(camera, Bounds(*bounds), records, normal, radiance, sent)


def _lens(camera: Camera) -> tuple[Any, Any]:
    return wp.vec4d(camera.fx, camera.fy, camera.cx, camera.cy), wp.vec2i(camera.width, camera.height)


def _items(surfels: Tensor) -> int:
    return -(-len(surfels) // surfels_an_item(as_on_cuda(surfels.device)))


def _new_bounds(like: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    count, device = len(like), like.device
    return (
        torch.empty(count, 4, dtype=torch.int32, device=device),
        torch.empty(count, dtype=torch.float64, device=device),
        torch.empty(count, dtype=torch.uint8, device=device),
        torch.empty(count, dtype=torch.bool, device=device),
    )


class _FromGeometry(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, camera: Camera, *surfels: Tensor) -> tuple[Tensor, ...]:
        given, pose = [value.contiguous() for value in surfels], camera.camera_to_world.contiguous()
        records, bounds = given[0].new_empty(len(given[0]), RECORD), _new_bounds(given[0])
        arguments = [len(records), pose, *_lens(camera), *given, records, *bounds]
        kernels = geometry_kernels(records.dtype, as_on_cuda(records.device))
        launch_in_parallel(kernels.forward, _items(records), records.device, lambda _: arguments)
        ctx.pose = pose
        ctx.save_for_backward(*given)
        ctx.mark_non_differentiable(*bounds)
        ctx.set_materialize_grads(False)
        return records, *bounds

    @staticmethod
    def backward(ctx: Any, pull: Tensor | None, *_: None) -> tuple[Tensor | None, ...]:
        given = ctx.saved_tensors
        if pull is None:
            return (None,) * (1 + len(given))
        out = [torch.empty_like(value) for value in given]
        arguments = [len(pull), ctx.pose, *given, pull.contiguous(), *out]
        kernels = geometry_kernels(pull.dtype, as_on_cuda(pull.device))
        launch_in_parallel(kernels.backward, _items(pull), pull.device, lambda _: arguments)
        return None, *out


class _FromSurfels(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, camera: Camera, shown_only: bool, *surfels: Tensor | None) -> tuple[Tensor | None, ...]:
        *geometry, sh = surfels
        given = [value.contiguous() for value in geometry if value is not None]
        centre, pose = given[0], camera.camera_to_world.contiguous()
        harmonics = centre.new_empty(0) if sh is None else sh.contiguous()
        coefficients = 0 if sh is None else sh.shape[1]
        given.append(harmonics)
        records, normal = centre.new_empty(len(centre), RECORD), torch.empty_like(centre)
        radiance = harmonics if sh is None else torch.empty_like(centre)
        sent = torch.empty_like(centre) if sh is not None and any(ctx.needs_input_grad) else radiance
        bounds, pixel = _new_bounds(centre), 2 / (camera.fx + camera.fy)
        arguments = [
            len(centre), pose, pixel, *_lens(camera), coefficients, int(shown_only), *given,
            records, normal, radiance, sent, *bounds,
        ]  # fmt: skip
        kernels = seen_kernels(centre.dtype, as_on_cuda(centre.device))
        launch_in_parallel(kernels.forward, _items(centre), centre.device, lambda _: arguments)
        ctx.settings = pose, pixel, coefficients
        ctx.save_for_backward(*given)
        ctx.mark_non_differentiable(*bounds)
        ctx.set_materialize_grads(False)
        return records, normal, *((None, None) if sh is None else (radiance, sent)), *bounds

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor | None) -> tuple[Tensor | None, ...]:
        given = ctx.saved_tensors
        pose, pixel, coefficients = ctx.settings
        absent, device = given[0].new_empty(0), given[0].device
        pulled = sum(1 << bit for bit, pull in enumerate(pulls[:4]) if pull is not None)
        by = [absent if pull is None else pull.contiguous() for pull in pulls[:4]]
        out = [torch.empty_like(value) for value in given]
        arguments = [len(given[0]), pose, pixel, coefficients, pulled, *given, *by, *out]
        kernels = seen_kernels(absent.dtype, as_on_cuda(device))
        launch_in_parallel(kernels.backward, _items(given[0]), device, lambda _: arguments)
        return None, None, *out[:4], out[4] if coefficients else None


@torch.no_grad()
def tile_lists(camera: Camera, bounds: Bounds) -> TileLists:
    """Sort the surfels into tiles of TILE x TILE pixels; tiles are numbered row by row.

    Depths are compared in float64. In a scene far from the origin, centres on a common lattice have depths that differ
    only by float32's rounding, and each pair that the rounding swaps changes the image (measured 1e6 units from the
    origin: by 0.018 in float32, by nothing in float64).
    """
    gather = sorted_lists if as_on_cuda(bounds.depth.device) else counted_lists
    starts, members = gather(camera, bounds)
    return TileLists(starts, members, bounds.touched)


def counted_lists(camera: Camera, bounds: Bounds) -> tuple[Int[Tensor, " tiles_and_one"], Int[Tensor, " entries"]]:
    """``starts`` and ``members`` by sorting and counting in one thread, for the CPU."""
    across, count = _grid(camera)
    if count > MOST_ENTRIES:
        _require_countable(int(_pairs(bounds.tiles).sum()))
    down, surfels, kernels = count // across, len(bounds.depth), binning_kernels()
    scratch = torch.empty(4, surfels, dtype=torch.int32)
    corners = torch.zeros(down + 1, across + 1, dtype=torch.int32)
    starts, tally = torch.empty(count + 1, dtype=torch.int32), torch.empty(5, dtype=torch.int64)
    values = [bounds.tiles, bounds.depth, bounds.kind, bounds.touched]
    launch(kernels.ordered, 1, tally.device, [surfels, across, down, *values, scratch, corners, starts, tally])
    drawn, entries, degenerate, faint, saturable = tally.tolist()
    fire(degenerate_surfels=degenerate, faint_surfels=faint, saturable_surfels=saturable)
    _require_countable(entries)
    members = torch.empty(entries, dtype=torch.int32)
    launch(kernels.listed, 1, tally.device, [drawn, across, count, scratch[2], bounds.tiles, starts, members])
    return starts, members


def sorted_lists(camera: Camera, bounds: Bounds) -> tuple[Int[Tensor, " tiles_and_one"], Int[Tensor, " entries"]]:
    """``starts`` and ``members`` by a stable sort of all pairs, for CUDA."""
    across, count = _grid(camera)
    kind, tiles = bounds.kind, bounds.tiles
    fire(
        degenerate_surfels=(kind == DEGENERATE).sum(),
        faint_surfels=(kind == FAINT).sum(),
        saturable_surfels=(kind == SATURABLE).sum(),
    )
    drawn = torch.nonzero(bounds.touched)[:, 0]
    nearest_first = drawn[_in_order(bounds.depth[drawn]).argsort(stable=True)]
    counts = _pairs(tiles[nearest_first])
    begins = counts.cumsum(0) - counts
    entries = int(counts.sum())
    _require_countable(entries)
    tile, member = (torch.empty(entries, dtype=torch.int32, device=tiles.device) for _ in range(2))
    write, arguments = binning_kernels().entries, [across, nearest_first, begins, tiles, tile, member]
    launch_in_parallel(write, len(nearest_first), tiles.device, lambda _: arguments)
    # Pairs come in depth order; a stable sort by tile keeps that order within each tile.
    tile, order = tile.sort(stable=True)
    starts = torch.searchsorted(tile, torch.arange(count + 1, dtype=torch.int32, device=tile.device), out_int32=True)
    return starts, member[order]


def _pairs(tiles: Int[Tensor, "surfels 4"]) -> Int64[Tensor, " surfels"]:
    """Number of tiles of each surfel."""
    first, last = tiles.long().view(-1, 2, 2).unbind(1)
    return (last - first + 1).prod(-1)


def _require_countable(entries: int) -> None:
    require_countable(entries, "pairs of a surfel and a tile", "Render a smaller image, or fewer surfels.")


def _in_order(numbers: Float64[Tensor, " numbers"]) -> Int64[Tensor, " numbers"]:
    """Integers in the order of the numbers: their bits, inverted for negative numbers.

    Integers are sorted by a radix sort, which for 100,000 of them takes a quarter of the time.
    """
    bits = numbers.view(torch.int64)
    return bits ^ ((bits >> 63) & torch.iinfo(torch.int64).max)


def _grid(camera: Camera) -> tuple[int, int]:
    """Number of tiles in a row, and in the whole image."""
    across = -(-camera.width // TILE)
    return across, across * -(-camera.height // TILE)
