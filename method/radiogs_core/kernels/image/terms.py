"""K17: all image losses of a step as one differentiable function of the blended images.

The kernels sum terms over blocks of pixels; a matrix of constants makes losses of the sums. Nothing is computed for a
loss whose weight is zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...scene.camera import Camera
from ...scene.colour import LINEAR_KNEE
from ..arguments import lens_of
from ..arrangement import as_on_cuda
from ..lanes import LANES
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel, scalar_type
from .blocks import BLOCK, blocks_in, columns_of
from .depth_map import PLANES, surface_kernel
from .display import DISPLAY, power_words
from .edges import edge_kernels
from .similarity import similarity_kernels

TERMS = native_file(__package__, "terms.inl", BLOCK, LANES, DISPLAY)

MASK_CONFIDENCE = 1e-6
"""Coverage is kept this far from 0 and 1 inside the logarithm: one wrong pixel costs at most 13.8 nats."""

MOST = 8
"""Largest number of images, and of maps."""

ENCODINGS = {"premultiplied": 0, "straight": 1, "display": 2}
"""Numbers of the encodings: the first two are those of ``display.displayed``; "display": radiance is display sRGB."""

ADDRESSES, COUNTS = wp.types.vector(MOST, wp.uint64), wp.types.vector(MOST, wp.int32)
"""The types by which a kernel takes the addresses of images or maps, and the numbers of the maps' channels."""


@dataclass(frozen=True)
class Compared:
    """How a blended image is compared with the target."""

    name: str
    """Name of the loss."""
    absolute: float
    """Weight of L1."""
    similarity: float
    """Weight of 1 - SSIM."""
    attached: bool = True
    """Whether coverage has a gradient by this comparison; the image has one anyway."""
    squared: float = 0.0
    """Weight of the squared error."""


@dataclass(frozen=True)
class Terms:
    """The image losses of a step and their weights. A loss with weight zero is left out, and costs nothing."""

    images: tuple[Compared, ...]
    """How each image is compared with the target."""
    encoding: str
    """How blended radiance becomes display colour: a name of ``ENCODINGS``."""
    background: float
    """Grey level, display sRGB, behind images and target."""
    mask: float
    """Weight of the binary cross-entropy between coverage and mask."""
    normal: float
    """Weight of the distance between blended normals and the depth map's normals."""
    one_sided: bool
    """Whether the depth map's normals are one-sided differences, which keep creases; else central ones."""
    distortion: float
    """Weight of the mean distortion."""
    far: float
    """Depth, world units, beyond which distortion is measured in disparity; 0: nowhere."""
    smoothness: tuple[tuple[str, float], ...] = ()
    """Names and weights of the edge-aware smoothness of the blended normals, and of each map."""
    masked: bool = False
    """Whether maps and normals are multiplied by the mask before their smoothness is measured."""


class Blended(NamedTuple):
    """Surfels blended in each pixel; all but ``depth`` multiplied by coverage."""

    alpha: Float[Tensor, "height width"]
    """Coverage."""
    normal: Float[Tensor, "height width 3"]
    """Blended normals in the world."""
    depth: Float[Tensor, "height width"]
    """Mean z-depth, world units."""
    distortion: Float[Tensor, "height width"]
    """Distortion of depth."""


class Aim(NamedTuple):
    """The target of the images and its weights; without gradient."""

    image: Float[Tensor, "height width 3"]
    """The target in display sRGB, on the background."""
    mask: Float[Tensor, "height width"]
    """Coverage of the target."""
    allowance: Float[Tensor, "2 height width 3"] | None
    """Weights of ``edges.edge_allowance``; None if no smoothness has a weight."""


def image_terms(
    terms: Terms,
    camera: Camera,
    aim: Aim,
    blended: Blended,
    images: Sequence[Float[Tensor, "height width 3"]],
    maps: Sequence[Float[Tensor, "height width _"]] = (),
) -> dict[str, Float[Tensor, ""]]:
    """The weighted losses by name, with gradient to ``blended``, ``images`` and ``maps``.

    Names are those in ``terms``, and "mask", "normal" and "distortion".

    Args:
        terms: What is computed.
        camera: Camera of the images.
        aim: What the images are compared with.
        blended: Coverage, normals, depths and distortion.
        images: Blended radiance, one for each of ``terms.images``.
        maps: Maps of 1 or 3 channels, one for each of ``terms.smoothness`` after the first.
    """
    widths = tuple(each.shape[-1] for each in maps)
    alpha, on_cuda = blended.alpha, as_on_cuda(blended.alpha.device)
    plan = _planned(terms, widths, alpha.shape, alpha.dtype, alpha.device, on_cuda)
    losses = _Terms.apply(plan, camera, aim, *blended, *images, *maps).unbind() if plan.names else ()
    return dict(zip(plan.names, losses, strict=True))


class _Plan:
    """The part of ``Terms`` that is computed, the indices of its sums, and the constants that turn sums into losses.

    ``images``, ``maps``: indices of the used ones; map 0 holds the normals.
    """

    def __init__(
        self,
        terms: Terms,
        widths: tuple[int, ...],
        shape: torch.Size,
        dtype: torch.dtype,
        device: torch.device,
        on_cuda: bool,
    ) -> None:
        self.terms, self.count = terms, len(terms.images)
        self.images = [k for k, each in enumerate(terms.images) if each.absolute or each.similarity or each.squared]
        self.maps = [k for k, (_, weight) in enumerate(terms.smoothness) if weight]
        self.widths = tuple((3, *widths)[k] for k in self.maps)
        self.attached = sum(terms.images[k].attached << place for place, k in enumerate(self.images))
        height, width = shape
        self.size, self.copied = (height, width), bool(self.maps) and (terms.masked or len(self.maps) > 1)
        self.kernels = term_kernels(dtype, on_cuda)
        self.items = blocks_in(height, width, columns_of(on_cuda))
        self.compare, self.surface = similarity_kernels(dtype, on_cuda), surface_kernel(dtype, on_cuda)
        self.smooth = edge_kernels(dtype, on_cuda, self.widths) if self.widths else None
        self.mixing, self.constant = (value.to(device, dtype) for value in self._place(height * width))
        self.unmixing = self.mixing.mT.contiguous()
        self.head = [*self.size, ENCODINGS[terms.encoding], int(terms.masked), self.mask, self.distortion]
        self.tail = [
            terms.background, terms.far, len(self.images), len(self.maps) if self.copied else 0,
            _filled(COUNTS, self.widths),
        ]  # fmt: skip

    def _place(self, pixels: int) -> tuple[Tensor, Tensor]:
        """Give each sum an index, -1 if it is absent, and name the losses.

        Returns the matrix by which sums become losses and what is added to them, float64.
        """
        terms = self.terms
        rows: list[tuple[str, dict[int, float], float]] = []
        for place, each in enumerate(terms.images[k] for k in self.images):
            weights = each.absolute, -each.similarity, each.squared
            mean = {3 * place + k: weight / (3 * pixels) for k, weight in enumerate(weights)}
            rows.append((each.name, mean, each.similarity))
        self.sums, single = 3 * len(self.images), []
        for name, weight in (("mask", terms.mask), ("normal", terms.normal), ("distortion", terms.distortion)):
            single.append(self.sums if weight else -1)
            if weight:
                rows.append((name, {self.sums: weight / pixels}, 0.0))
                self.sums += 1
        self.mask, self.normal, self.distortion = single
        self.first_map = self.sums
        for name, weight in (terms.smoothness[k] for k in self.maps):
            rows.append((name, {self.sums: weight / (3 * pixels)}, 0.0))
            self.sums += 1
        self.names = [name for name, _, _ in rows]
        mixing = [[entries.get(column, 0.0) for column in range(self.sums)] for _, entries, _ in rows]
        constants = [constant for _, _, constant in rows]
        return torch.tensor(mixing, dtype=torch.float64), torch.tensor(constants, dtype=torch.float64)


_planned = lru_cache(maxsize=64)(_Plan)


class _Terms(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, plan: _Plan, camera: Camera, aim: Aim, *given: Tensor) -> Tensor:
        alpha, normal, depth, distortion, *others = (each.contiguous() for each in given)
        like, images = alpha, [others[k] for k in plan.images]
        maps = [(normal, *others[plan.count :])[k] for k in plan.maps]
        sums = like.new_empty(plan.sums, plan.items)
        encoded, shown = (like.new_empty(len(images), *plan.size, 3) for _ in range(2))
        together = like.new_empty(*plan.size, sum(plan.widths)) if plan.copied else maps[0] if maps else encoded
        addresses = _addresses(images)
        arguments = [
            *plan.head, *plan.tail, addresses, _addresses(maps),
            alpha, depth, distortion, aim.mask, encoded, shown, together, sums,
        ]  # fmt: skip
        launch_in_parallel(plan.kernels.forward, plan.items, like.device, arguments)
        slopes = _compare(plan, aim, shown, sums)
        normals = _orient(plan, camera, alpha, normal, depth, sums)
        answers = _smooth(plan, aim, together, sums)
        ctx.plan, ctx.addresses, ctx.further = plan, addresses, len(others)
        ctx.save_for_backward(
            alpha, depth, aim.image, aim.mask, encoded, shown, slopes, normals, answers, *images
        )  # fmt: skip
        return torch.addmv(plan.constant, plan.mixing, sums.sum(1))

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor | None, ...]:
        plan: _Plan = ctx.plan
        alpha, depth, target, mask, encoded, shown, slopes, normals, answers, *images = ctx.saved_tensors
        pulls = plan.unmixing @ pull
        of_shown = _pull_images(plan, shown, target, slopes, pulls)
        of_maps = _pull_maps(plan, answers, pulls)
        to_alpha, to_images = torch.empty_like(alpha), [torch.empty_like(each) for each in images]
        to_maps = [alpha.new_empty(*plan.size, width) for width in plan.widths] if plan.copied else [of_maps]
        smoothed = plan.maps[:1] == [0]
        to_normal = to_maps[0] if smoothed else alpha.new_empty(*plan.size, 3) if plan.normal >= 0 else None
        to_depth = torch.empty_like(alpha) if plan.normal >= 0 else None
        to_distortion = torch.empty_like(alpha) if plan.distortion >= 0 else None
        outputs = [alpha if each is None else each for each in (to_normal, to_depth, to_distortion)]
        arguments = [
            *plan.head, plan.normal, int(smoothed), plan.attached, *plan.tail,
            ctx.addresses, _addresses(to_images), _addresses(to_maps),
            alpha, depth, mask, encoded, normals, of_shown, of_maps, pulls, to_alpha, *outputs,
        ]  # fmt: skip
        launch_in_parallel(plan.kernels.backward, plan.items, alpha.device, arguments)
        others: list[Tensor | None] = [None] * ctx.further
        for place, found in zip(plan.images, to_images, strict=True):
            others[place] = found
        for place, found in zip(plan.maps, to_maps, strict=False):
            if place > 0:
                others[plan.count + place - 1] = found
        return None, None, None, to_alpha, to_normal, to_depth, to_distortion, *others


def _filled(kind: Any, numbers: Sequence[int]) -> Any:
    """A kernel's vector of integers: the numbers, then zeros."""
    return kind(*numbers, *[0] * (MOST - len(numbers)))


def _addresses(tensors: Sequence[Tensor]) -> Any:
    """The addresses of tensors, as a kernel takes them."""
    return _filled(ADDRESSES, [tensor.data_ptr() for tensor in tensors])


@cache
def term_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels of the per-pixel terms; an item is a block of pixels in one row.

    The forward kernel also prepares what is compared with neighbours: images in display colour, and masked maps. Images
    and maps are passed by their addresses, and maps by their ``widths``, the numbers of their channels. A term that is
    absent has index -1. ``maps``: the maps with interleaved channels. ``masked``: 1: they are multiplied by the mask.
    ``far``: depth beyond which distortion is measured in disparity; 0: nowhere. ``normals``: see ``surface_kernel``.
    ``attached``: bit k: coverage has a gradient by image k.
    """
    words = {
        **power_words(dtype), **PLANES, "ENTRIES": 1, "REACH": 0, "BLOCK_COLUMNS": columns_of(on_cuda),
        "VECTOR_SIZE": 1 if on_cuda else 16, "KNEE": LINEAR_KNEE, "CONFIDENCE": MASK_CONFIDENCE,
        "STRAIGHT": ENCODINGS["straight"], "IN_DISPLAY": ENCODINGS["display"],
    }  # fmt: skip
    make, arrays = partial(native_kernel, TERMS, dtype, NATIVE, on_cuda=on_cuda, words=words), flat(dtype)
    head = wp.int32, "height width encoding masked mask_term distortion_term"
    tail = (scalar_type(dtype), "background far"), (wp.int32, "images map_count"), (COUNTS, "widths")
    forward = (
        head,
        *tail,
        (ADDRESSES, "blended given_maps"),
        (arrays, "alpha depth distortion mask encoded shown maps sums"),
    )
    backward = (
        head,
        (wp.int32, "normal_term normal_is_smoothed attached"),
        *tail,
        (ADDRESSES, "blended to_blended to_maps"),
        (arrays, "alpha depth mask encoded normals of_shown of_maps pulls"),
        (arrays, "to_alpha to_normal to_depth to_distortion"),
    )
    return Pair(make("forward", "item", *forward), make("backward", "item", *backward))


def _compare(plan: _Plan, aim: Aim, shown: Tensor, sums: Tensor) -> Tensor:
    """Add up L1, SSIM and the squared error of the images; returns the slopes of SSIM."""
    slopes = shown.new_empty((3, *shown.shape))
    if plan.images:
        arguments = [len(shown), *plan.size, 1, shown, aim.image, slopes, sums]
        launch_in_parallel(plan.compare.forward, plan.items, shown.device, arguments)
    return slopes


def _pull_images(plan: _Plan, shown: Tensor, target: Tensor, slopes: Tensor, pulls: Tensor) -> Tensor:
    out = torch.empty_like(shown)
    if plan.images:
        arguments = [len(shown), *plan.size, shown, target, slopes, pulls, out]
        launch_in_parallel(plan.compare.backward, len(shown) * plan.items, shown.device, arguments)
    return out


def _orient(plan: _Plan, camera: Camera, alpha: Tensor, normal: Tensor, depth: Tensor, sums: Tensor) -> Tensor:
    """Add up the distances of the normals from the depth map's; returns the latter and the sum's derivatives."""
    out = alpha.new_empty((8, *plan.size) if plan.normal >= 0 else 0)
    if plan.normal >= 0:
        lens, pose = lens_of(camera), camera.camera_to_world.to(alpha).contiguous()
        arguments = [*plan.size, int(plan.terms.one_sided), plan.normal, lens, pose, depth, alpha, normal, out, sums]
        launch_in_parallel(plan.surface, plan.items, alpha.device, arguments)
    return out


def _smooth(plan: _Plan, aim: Aim, maps: Tensor, sums: Tensor) -> Tensor:
    """Add up the weighted gradients of the maps; returns their signs times their weights."""
    if plan.smooth is None or aim.allowance is None:
        return maps.new_empty(0)
    answers = maps.new_empty(2, *maps.shape)
    arguments = [*plan.size, plan.first_map, 1, maps, aim.allowance, answers, sums]
    launch_in_parallel(plan.smooth.forward, plan.items, maps.device, arguments)
    return answers


def _pull_maps(plan: _Plan, answers: Tensor, pulls: Tensor) -> Tensor:
    if plan.smooth is None:
        return answers
    out = answers.new_empty(answers.shape[1:])
    arguments = [*plan.size, plan.first_map, answers, pulls, out]
    launch_in_parallel(plan.smooth.backward, plan.items, out.device, arguments)
    return out
