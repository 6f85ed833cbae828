"""K15 and K8: the world points of a depth map, and normals from points by one-sided differences; differentiable."""

from functools import cache, partial
from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Bool, Float
from torch import Tensor

from ...scene.camera import Camera
from ..arguments import lens_of
from ..differentiable import differentiable
from ..lanes import LANES
from ..native_kernel import BYTES, SIGNS, Pair, flat, native_file, native_kernel
from ..runtime import ITEMWISE, NATIVE, launch_in_parallel
from .blocks import BLOCK, columns_of

POINTS = native_file(__package__, "points.inl")

NORMALS = native_file(__package__, "normals.inl", BLOCK, LANES)

NO_SECOND_NEIGHBOUR = 1e6
"""Curvature that is assigned to a side with only one neighbour: it is chosen only if the other side has none."""

NO_NEIGHBOUR = 1e30
"""Curvature that is assigned to a side without a neighbour: it is never chosen."""

CURVATURES = {"ABSENT": NO_NEIGHBOUR, "ALONE": NO_SECOND_NEIGHBOUR}

SOLID_ALPHA = 0.5
"""Coverage from which a pixel shows a surface, so that its depth is meaningful."""

PLANES = {"OWN_PLANE": 3, "RIGHT_PLANE": 4, "LEFT_PLANE": 5, "BELOW_PLANE": 6, "ABOVE_PLANE": 7}
"""Planes of the output of ``surface_kernel`` after the normal's three: derivatives with respect to the depth of the
pixel itself and of its neighbours."""


def points_of(camera: Camera, depth: Float[Tensor, "height width"]) -> Float[Tensor, "height width 3"]:
    """The world point of each pixel at its z-depth (world units); the camera's centre where the depth is zero."""
    camera = camera.to(depth.device, depth.dtype)
    constants = depth.shape[1], lens_of(camera), camera.camera_to_world.contiguous()
    return differentiable(point_kernels(depth.dtype), depth.numel(), constants, [(*depth.shape, 3)], depth)[0]


@cache
def point_kernels(dtype: torch.dtype) -> Pair:
    """The kernels of points for a scalar type; an item is a pixel. ``pose``: camera to world, four rows of four."""
    make, arrays = partial(native_kernel, POINTS, dtype, ITEMWISE), flat(dtype)
    given = (wp.int32, "width"), (wp.vec4d, "lens"), (arrays, "pose depth")
    return Pair(
        make("forward", "item", *given, (arrays, "out")), make("backward", "item", *given, (arrays, "pull out"))
    )


def one_sided_normals(
    points: Float[Tensor, "height width 3"],
    depth: Float[Tensor, "height width"],
    solid: Bool[Tensor, "height width"],
    toward: Float[Tensor, "3"],
) -> Float[Tensor, "height width 3"]:
    """Unit normals in the world by differences to one neighbour along each axis, on the side of less curvature.

    At a crease or a silhouette central differences join two surfaces; the side of less curvature lies on one of them.
    Curvature is measured by the second difference of inverse z-depth, which is zero on any plane. The normal is zero
    for a pixel without surface, for one without a neighbour that has a surface along an axis, and where neighbouring
    points coincide. Only the points get gradients.

    Args:
        points: World points of the pixels.
        depth: z-depths of the pixels, world units.
        solid: Whether each pixel has a surface.
        toward: The camera's centre in the world; normals face it.
    """
    return _OneSided.apply(points, depth, solid, toward)


class _OneSided(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, points: Tensor, depth: Tensor, solid: Tensor, toward: Tensor) -> Tensor:
        points = points.detach().contiguous()
        kernels, (height, width) = normal_kernels(points.dtype), depth.shape
        sides = torch.empty(height, width, 2, dtype=torch.int8, device=points.device)
        out = torch.empty_like(points)
        flags = solid.contiguous().view(torch.uint8)
        given = points, depth.detach().contiguous(), flags, toward.contiguous(), out, sides
        arguments = [height, width, *given]
        launch_in_parallel(kernels.forward, height * width, out.device, arguments)
        ctx.save_for_backward(points, out, sides)
        return out

    @staticmethod
    def backward(ctx: Any, pull: Tensor) -> tuple[Tensor, None, None, None]:
        points, normal, sides = ctx.saved_tensors
        height, width = sides.shape[:2]
        kernels, steps = normal_kernels(points.dtype), points.new_empty(height, width, 6)
        out = torch.empty_like(points)
        of_steps = [width, points, normal, sides, pull.contiguous(), steps]
        launch_in_parallel(kernels.pull, height * width, out.device, of_steps)
        launch_in_parallel(kernels.gather, height * width, out.device, [height, width, sides, steps, out])
        return out, None, None, None


class NormalKernels(NamedTuple):
    """Kernels of one-sided normals; an item is a pixel."""

    forward: wp.Kernel
    """Normals, and the chosen ``sides`` of each pixel along x and y: 1 or -1; 0 for a pixel without a normal."""
    pull: wp.Kernel
    """Propagates each normal's gradient to its differences along x and y, the ``steps``."""
    gather: wp.Kernel
    """Adds up, for each point, the gradients from the differences at its own pixel and at its four neighbours."""


@cache
def normal_kernels(dtype: torch.dtype) -> NormalKernels:
    """The kernels of one-sided normals for a scalar type."""
    make, arrays = partial(native_kernel, NORMALS, dtype, ITEMWISE, words=CURVATURES), flat(dtype)
    size, sides = (wp.int32, "height width"), (SIGNS, "sides")
    return NormalKernels(
        make("forward", "item", size, (arrays, "points depth"), (BYTES, "solid"), (arrays, "toward out"), sides),
        make("pull", "item", (wp.int32, "width"), (arrays, "points normal"), sides, (arrays, "given steps")),
        make("gather", "item", size, sides, (arrays, "steps out")),
    )


@cache
def surface_kernel(dtype: torch.dtype, on_cuda: bool) -> wp.Kernel:
    """The kernel of the normals of the surface in a depth map, and how they agree with a given field of vectors.

    An item is a block of pixels. ``depth``: z-depths; there is a surface where ``alpha`` reaches SOLID_ALPHA.
    ``field``: the given vectors g. ``one_sided``: 0: central differences, and no normal beside a pixel without surface.
    ``sums``, at ``term``: alpha - g . normal of pixels with a normal, summed over each block. ``out``: planes of the
    normals in the world, zero where there is none, and of the derivatives of this sum (see ``PLANES``).
    """
    words = {
        **CURVATURES, "ENTRIES": 1, "REACH": 2, "BLOCK_COLUMNS": columns_of(on_cuda),
        "VECTOR_SIZE": 1 if on_cuda else 16, "SOLID": SOLID_ALPHA, **PLANES,
    }  # fmt: skip
    numbers, arrays = (wp.int32, "height width one_sided term"), (flat(dtype), "pose depth alpha field out sums")
    parameters = numbers, (wp.vec4d, "lens"), arrays
    return native_kernel(NORMALS, dtype, NATIVE, "surface", "item", *parameters, on_cuda=on_cuda, words=words)
