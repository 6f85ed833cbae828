"""K11: surfels projected into a camera: their homographies, and their bounds on the screen.

``project`` begins with a geometry, ``project_surfels`` with raw parameters: what a step or a frame needs of surfels for
one camera is one launch, and one more for all gradients.

A surfel's record is its homography of pixel rays (see ``rasterize``), its opacity and the square of its support radius.
With t = centre - eye it consists of offset = n . t, m_u = offset axis_u - (axis_u . t) n and m_v likewise; n, m_u and
m_v are in camera axes. Bounds are computed in float64: far from the origin the rounding errors of float32 are as large
as a pixel.
"""

from dataclasses import dataclass, fields
from functools import cache, cached_property, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...scene.camera import Camera
from ..arguments import lens_of
from ..arrangement import an_item, as_on_cuda, items_of
from ..lanes import LANES, exponential_words, logarithm_words
from ..native_kernel import BYTES, DOUBLES, FLAGS, INTEGERS, Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE, launch_in_parallel, scalar_type
from ..surfel.footprint import FOOTPRINT, FOOTPRINT_WORDS, FRAME
from ..surfel.geometry import SplatGeometry
from ..surfel.harmonics import HARMONICS
from ..surfel.support import REGULAR, SUPPORT, SUPPORT_WORDS
from .binning import TILE, Bounds, TileLists, tile_lists

PROJECTION = native_file(__package__, "projection.inl", LANES, FRAME, FOOTPRINT, SUPPORT, HARMONICS)

RECORD = 12
"""Scalars of a surfel's record: n' (3), m_u (3), m_v (3), offset, opacity, squared support radius."""

SURFELS_ON_CPU = 128
"""Surfels of an item on the CPU."""


@dataclass(frozen=True)
class Projection:
    """Surfels projected into one camera, which can be blended any number of times; see ``project``."""

    camera: Camera
    """The camera."""
    bounds: Bounds
    """Where the surfels can lie on the screen."""
    records: Float[Tensor, "surfels 12"]
    """The surfels' homographies of pixel rays, opacities and squared support radii."""

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

    A surfel's radiance is max(0, SH + 1/2) along the ray from the camera; at the camera's centre there is no ray and no
    gradient. Gradients flow to all parameters; footprints and support radii are constants.

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
        size = wp.vec2i(camera.width, camera.height)
        arguments = [len(records), pose, lens_of(camera), size, *given, records, *bounds]
        ctx.kernels = geometry_kernels(records.dtype, as_on_cuda(records.device))
        ctx.pose, ctx.items = pose, items_of(len(records), records.device, SURFELS_ON_CPU)
        launch_in_parallel(ctx.kernels.forward, ctx.items, records.device, arguments)
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
        launch_in_parallel(ctx.kernels.backward, ctx.items, pull.device, arguments)
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
        bounds, pixel, size = _new_bounds(centre), 2 / (camera.fx + camera.fy), wp.vec2i(camera.width, camera.height)
        arguments = [
            len(centre), pose, pixel, lens_of(camera), size, coefficients, int(shown_only), *given,
            records, normal, radiance, sent, *bounds,
        ]  # fmt: skip
        ctx.kernels = seen_kernels(centre.dtype, as_on_cuda(centre.device))
        ctx.settings, ctx.items = (pose, pixel, coefficients), items_of(len(centre), centre.device, SURFELS_ON_CPU)
        launch_in_parallel(ctx.kernels.forward, ctx.items, centre.device, arguments)
        ctx.save_for_backward(*given)
        ctx.mark_non_differentiable(*bounds)
        ctx.set_materialize_grads(False)
        return records, normal, *((None, None) if sh is None else (radiance, sent)), *bounds

    @staticmethod
    def backward(ctx: Any, *pulls: Tensor | None) -> tuple[Tensor | None, ...]:
        given = ctx.saved_tensors
        pose, pixel, coefficients = ctx.settings
        absent = given[0].new_empty(0)
        pulled = sum(1 << bit for bit, pull in enumerate(pulls[:4]) if pull is not None)
        by = [absent if pull is None else pull.contiguous() for pull in pulls[:4]]
        out = [torch.empty_like(value) for value in given]
        arguments = [len(given[0]), pose, pixel, coefficients, pulled, *given, *by, *out]
        launch_in_parallel(ctx.kernels.backward, ctx.items, absent.device, arguments)
        return None, None, *out[:4], out[4] if coefficients else None


def _words(dtype: torch.dtype, on_cuda: bool) -> dict[str, object]:
    return {
        **logarithm_words(dtype),
        **exponential_words(dtype),
        "SURFELS_A_VECTOR": 1 if on_cuda else 16,
        "SURFELS_AN_ITEM": an_item(on_cuda, SURFELS_ON_CPU),
        "TILE": TILE,
        "REGULAR": REGULAR,
        **FOOTPRINT_WORDS,
        **SUPPORT_WORDS,
    }


BOUNDS = (INTEGERS, "out_tiles"), (DOUBLES, "out_depth"), (BYTES, "out_kind"), (FLAGS, "out_touched")
"""The last parameters of kernels that project: the fields of ``Bounds``."""


@cache
def geometry_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels from a ``SplatGeometry`` for a scalar type and a division of work; an item is some surfels.

    ``pose``: camera to world. ``size``: width and height of the image.
    """
    words, arrays = _words(dtype, on_cuda), flat(dtype)
    make = partial(native_kernel, PROJECTION, dtype, ITEMWISE, on_cuda=on_cuda, words=words)
    begin, given = ((wp.int32, "surfels"), (arrays, "pose")), (arrays, "centre axis_u axis_v normal opacity")
    camera, pulls = ((wp.vec4d, "lens"), (wp.vec2i, "size")), (arrays, "pull to_centre to_u to_v to_normal to_opacity")
    forward = make("geometry_forward", "item", *begin, *camera, given, (arrays, "out_records"), *BOUNDS)
    return Pair(forward, make("geometry_backward", "item", *begin, given, pulls))


@cache
def seen_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels from raw parameters for a scalar type and a division of work; an item is some surfels.

    They compute frames, footprints, supports and radiance for a view. ``size_of_pixel``: side of a pixel at depth 1,
    world units. ``coefficients``: number of harmonics; 0 leaves the radiance out. ``shown_only``: whether the radiance
    of surfels beside the image may be zero. ``pulled``: a bit for each of the pulls that are given.
    """
    words, arrays = _words(dtype, on_cuda), flat(dtype)
    make = partial(native_kernel, PROJECTION, dtype, ITEMWISE, on_cuda=on_cuda, words=words)
    begin = (wp.int32, "surfels"), (arrays, "pose"), (scalar_type(dtype), "size_of_pixel")
    given = arrays, "centre rotation log_scale opacity_logit sh"
    forward = (
        *begin,
        (wp.vec4d, "lens"),
        (wp.vec2i, "size"),
        (wp.int32, "coefficients shown_only"),
        given,
        (arrays, "out_records out_normal out_radiance out_sent"),
        *BOUNDS,
    )
    backward = (
        *begin,
        (wp.int32, "coefficients pulled"),
        given,
        (arrays, "pull_records pull_normal pull_radiance pull_sent"),
        (arrays, "to_centres to_rotations to_log_scales to_logits to_sh"),
    )
    return Pair(make("raw_forward", "item", *forward), make("raw_backward", "item", *backward))
