"""K5, K10 and K19: frames of surfels from quaternions, and surfels as cameras and rays meet them; differentiable.

For rays the axes are the tangents over the scales; for a camera, surfels are widened by a pixel's footprint.

With s = (s_u, s_v) the scales, v the variance of a pixel at the surfel's depth, (a, b) the view direction's component
in the plane and c its cosine to the normal, the covariance is

    diag(s^2) + v (1 + (a, b) (a, b)^T / c^2) = L L^T,   L = [first 0; mixed second],

and the axes are the rows of L^-1 along the tangents. Footprints have no gradient: v, a, b and c are constants.
"""

from functools import cache, partial

import torch
from jaxtyping import Float
from torch import Tensor

from ...scene.camera import Camera
from ..differentiable import differentiable
from ..lanes import LANES
from ..native_kernel import Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE, scalar_type
from .geometry import SplatGeometry

FRAME = native_file(__package__, "frame.inl", LANES)

FOOTPRINT = native_file(__package__, "footprint.inl", LANES)

AXES = native_file(__package__, "axes.inl")

PIXEL_FILTER_VARIANCE = 1 / 12
"""Variance, in pixels^2, of the square that a pixel averages over, by which a surfel is widened."""

EDGE_ON_COSINE = 0.05
"""Cosine between view direction and normal below which a pixel's footprint in a surfel's plane does not grow further:
at 87 degrees it is 20 pixels long."""

FOOTPRINT_WORDS = {"PIXEL_VARIANCE": PIXEL_FILTER_VARIANCE, "LEAST_COSINE": EDGE_ON_COSINE**2}
"""The values of the words in ``FOOTPRINT``."""


def frames(rotation: Float[Tensor, "surfels 4"]) -> Float[Tensor, "surfels 3 3"]:
    """Rotation matrices of quaternions (w, x, y, z) of any length; zero for a zero quaternion."""
    return differentiable(frame_kernels(rotation.dtype), len(rotation), (), [(len(rotation), 3, 3)], rotation)[0]


@cache
def frame_kernels(dtype: torch.dtype) -> Pair:
    """The kernels of frames for a scalar type; an item is a surfel."""
    make = partial(native_kernel, FRAME, dtype, ITEMWISE, on_cuda=True)
    forward = make("forward", "surfel", (flat(dtype), "rotation out"))
    return Pair(forward, make("backward", "surfel", (flat(dtype), "rotation pull out")))


def widened(
    camera: Camera,
    centre: Float[Tensor, "surfels 3"],
    frame: Float[Tensor, "surfels 3 3"],
    scale: Float[Tensor, "surfels 2"],
    opacity: Float[Tensor, " surfels"],
) -> SplatGeometry:
    """Surfels in the world, widened in their own planes by the footprint of a pixel.

    A pixel has a longer footprint on a surfel that is seen at an angle. With w the component of the view direction in
    the surfel's plane (along t_u, t_v) and c its cosine to the normal, the covariance becomes
    diag(s^2) + variance (z / f)^2 (1 + w w^T / c^2). The opacity falls by the ratio of the areas, so that a surfel that
    is smaller than a pixel, or is seen from the edge, keeps its energy and is not missed between pixel centres.

    Gradients flow to frame, scale and opacity; the footprint itself is treated as a constant.

    Args:
        camera: Camera that sees the surfels.
        centre: Positions in the world.
        frame: Rotations with columns t_u, t_v, n, in the world.
        scale: Standard deviations along t_u and t_v, world units.
        opacity: Peak opacities.
    """
    camera, kernels = camera.to(centre.device, centre.dtype), footprint_kernels(centre.dtype)
    pose, shape = camera.camera_to_world.contiguous(), centre.shape
    constants = pose, 2 / (camera.fx + camera.fy), centre.detach().contiguous()
    shapes = shape, shape, shape, shape[:1]
    return SplatGeometry(
        centre, *differentiable(kernels, len(centre), constants, shapes, frame, scale, opacity)
    )  # fmt: skip


@cache
def footprint_kernels(dtype: torch.dtype) -> Pair:
    """The kernels of widened surfels for a scalar type; an item is a surfel.

    ``pose``: the camera-to-world matrix. ``size_of_pixel``: side of a pixel at depth 1, world units.
    """
    make = partial(native_kernel, FOOTPRINT, dtype, ITEMWISE, on_cuda=True, words=FOOTPRINT_WORDS)
    arrays = flat(dtype)
    given = (arrays, "pose"), (scalar_type(dtype), "size_of_pixel"), (arrays, "centre frame scale opacity")
    out = arrays, "out_u out_v out_normal out_opacity"
    pulls = arrays, "pull_u pull_v pull_normal pull_opacity to_frames to_scales to_opacities"
    return Pair(make("forward", "surfel", *given, out), make("backward", "surfel", *given, pulls))


def met_by_rays(
    centre: Float[Tensor, "surfels 3"],
    frame: Float[Tensor, "surfels 3 3"],
    log_scale: Float[Tensor, "surfels 2"],
    opacity_logit: Float[Tensor, " surfels"],
) -> SplatGeometry:
    """The geometry of surfels for the ray tracer, with gradient to all arguments.

    Args:
        centre: Positions in the world.
        frame: Rotations with columns t_u, t_v, n, in the world.
        log_scale: Logarithms of the standard deviations along t_u and t_v, world units.
        opacity_logit: Logits of the peak opacities.
    """
    shapes = frame.shape[:2], frame.shape[:2], frame.shape[:2], frame.shape[:1]
    kernels, surfels = axes_kernels(frame.dtype), len(frame)
    return SplatGeometry(centre, *differentiable(kernels, surfels, (), shapes, frame, log_scale, opacity_logit))


@cache
def axes_kernels(dtype: torch.dtype) -> Pair:
    """The kernels for a scalar type; an item is a surfel."""
    make = partial(native_kernel, AXES, dtype, ITEMWISE)
    given = flat(dtype), "frame log_scale opacity_logit"
    out = flat(dtype), "out_u out_v out_normal out_opacity"
    pulls = flat(dtype), "pull_u pull_v pull_normal pull_opacity to_frames to_log_scales to_logits"
    return Pair(make("forward", "surfel", given, out), make("backward", "surfel", given, pulls))
