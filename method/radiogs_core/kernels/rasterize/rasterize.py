"""K1: rasterize surfels into any number of feature channels, in one pass, with gradient to every parameter."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ...instruments import count
from ...instruments.finite import require_finite_blend
from ...scene.camera import Camera
from ..arrangement import as_on_cuda
from ..runtime import WorkerSums, as_array, launch_in_parallel
from ..surfel.geometry import SplatGeometry
from .binning import TileLists, tile_lists
from .rasterize_source import PIXEL_SUMS, TILE, blend_kernels, pixels_an_item
from .records import records_of


@dataclass(frozen=True)
class Raster:
    """What each pixel sees; everything is multiplied by coverage, on a background of zero.

    features: sum_i w_i f_i. alpha: sum_i w_i. depth: sum_i w_i z_i, world units along the forward axis.
    distortion: sum_{i<j} w_i w_j ((z_i - z_j) / depth_unit)^2. touched: the surfel's bounds meet the image.
    """

    features: Float[Tensor, "height width channels"]
    alpha: Float[Tensor, "height width"]
    depth: Float[Tensor, "height width"]
    distortion: Float[Tensor, "height width"]
    touched: Bool[Tensor, " surfels"]


@dataclass(frozen=True)
class Projection:
    """Surfels as one camera meets them, ready to be blended any number of times; see ``project``."""

    camera: Camera
    lists: TileLists
    records: Float[Tensor, "surfels numbers"]


def project(camera: Camera, geometry: SplatGeometry) -> Projection:
    """Sort surfels into the tiles of an image, by the depth of their centres (2DGS; ties by index).

    Surfels that are degenerate (non-finite or without extent), fainter than ALPHA_THRESHOLD, facing away or behind the
    camera take no part.
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

    Gradients flow from all images to what was projected and to ``features``; from the channels ``detached`` to their
    features alone. ``depth_unit`` (world units) makes the distortion independent of the scene's scale. Raises
    NumericalFailure if a surfel in view has a feature that is not finite.
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
    """``blend`` what ``project`` makes of the surfels."""
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
            # The gradient to a feature does not depend on its value, and that to a weight is a product with it.
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
    """The values, with zeros in some of the channels."""
    values = values.clone()
    for each in channels:
        values[:, each] = 0
    return values


def _arguments(kernels: Any, camera: Camera, lists: TileLists, depth_unit: float, splats: Any) -> list[Any]:
    image = kernels.Image()
    image.width, image.height, image.tiles_across = camera.width, camera.height, -(-camera.width // TILE)
    image.fx, image.fy, image.cx, image.cy = camera.fx, camera.fy, camera.cx, camera.cy
    image.depth_unit = depth_unit
    packed = kernels.Splats()
    packed.starts, packed.members = as_array(lists.starts), as_array(lists.members)
    packed.records, packed.features = map(as_array, splats)
    return [image, packed]


def _items(camera: Camera, device: torch.device) -> int:
    """Items of the kernels in whole tiles."""
    tiles = -(-camera.width // TILE) * -(-camera.height // TILE)
    return tiles * TILE * TILE // pixels_an_item(as_on_cuda(device))
