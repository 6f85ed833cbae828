"""L_rad by the sums of K3: the surfels' own radiance against what they reflect; fused and differentiable."""

from functools import cache, partial
from typing import Any

import torch
import warp as wp
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ..arrangement import as_on_cuda
from ..lanes import LANES
from ..native_kernel import LONGS, Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, launch_in_parallel, scalar_type
from ..surfel.harmonics import HARMONICS
from .shade import (
    SHADE,
    count_samples,
    incident_gradients,
    inputs_of,
    light_gradient,
    shading_inputs,
    shading_words,
)

CONSISTENCY = native_file(__package__, "consistency.inl", LANES, HARMONICS, SHADE)


def consistency_of(
    index: Int[Tensor, " chosen"],
    camera: Float[Tensor, "3"],
    drawn: Float[Tensor, "chosen 3"],
    centre: Float[Tensor, "surfels 3"],
    sh: Float[Tensor, "surfels coefficients 3"],
    frame: Float[Tensor, "surfels 3 3"],
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    direction: Float[Tensor, "chosen samples 3"],
    weight: Float[Tensor, "chosen samples"],
    visibility: Float[Tensor, "chosen samples"],
    indirect: Float[Tensor, "chosen samples 3"],
    environment: Float[Tensor, "height width 3"],
    specular_at: Bool[Tensor, " surfels"] | None = None,
    own_learns: bool = True,
    physical_learns: bool = True,
) -> Float[Tensor, ""]:
    """L_rad: mean over the surfels ``index`` and channels of |L_G - L_PBR|, summed over two directions.

    L_G is the surfels' own radiance max(0, harmonics + 1/2), L_PBR the sum of the four parts of ``shade``. The
    directions are that towards the camera and the drawn one; a direction below the surface counts as zero. They have no
    gradient.

    Args:
        index: The surfels that are compared, each once.
        camera: The camera's centre in the world.
        drawn: Vectors of any length; a direction's side is changed if it lies below the surface.
        centre: Centres of the surfels in the world.
        sh: Harmonics of L_G (see ``surfels.harmonics``).
        frame: Rotation matrices; their third columns are the unit normals.
        albedo: Linear diffuse albedo of all surfels.
        roughness: Perceptual roughness of all surfels.
        direction: Unit directions in the world from the chosen surfels towards the light.
        weight: Solid angle of each direction, in steradian.
        visibility: V along each direction.
        indirect: L_ind along each direction, linear RGB.
        environment: Distant light; see ``shade``.
        specular_at: Whether each surfel has a specular lobe (None: all).
        own_learns: Whether L_G has gradient.
        physical_learns: Whether L_PBR has gradient.
    """
    return _Consistency.apply(
        own_learns, physical_learns, index, camera, drawn, centre, sh,
        frame, albedo, roughness, direction, weight, visibility, indirect, environment, specular_at,
    )  # fmt: skip


class _Consistency(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, own_learns: bool, physical_learns: bool, *inputs: Tensor | None) -> Tensor:
        sides = [value.contiguous() for value in inputs[:5] if value is not None]
        shaded = tuple(None if value is None else value.contiguous() for value in inputs[5:])
        index, *places, sh = sides
        direction, specular_at = shaded[3], shaded[8]
        assert direction is not None
        ctx.kernels = consistency_kernels(sh.dtype, as_on_cuda(sh.device))
        ctx.given = shading_inputs((*shaded[:3], None, *shaded[3:]))
        needs = ctx.needs_input_grad
        ctx.wants_own, ctx.wants_physical = own_learns and needs[6], physical_learns and any(needs[7:])
        ctx.wants_incident, ctx.wants_environment = needs[12] or needs[13], needs[14]
        # The light's derivative needs the places of its texels, so that what was found there need not be kept.
        ctx.keeps_light = ctx.wants_physical and not ctx.wants_environment
        chosen = len(index)
        losses, ctx.slopes = sh.new_empty(chosen), sh.new_empty(chosen, 2, 2, 3)
        ctx.lights = torch.empty_like(direction) if ctx.keeps_light else losses[:0]
        scale = 1 / max(1, 3 * chosen)
        arguments = [
            *ctx.given, index, *places, sh.shape[1], sh, scale, int(ctx.keeps_light), losses, ctx.slopes, ctx.lights
        ]  # fmt: skip
        launch_in_parallel(ctx.kernels.forward, chosen, sh.device, arguments)
        count_samples(2, direction, None if specular_at is None else specular_at[index])
        ctx.save_for_backward(*sides, *shaded)
        return losses.sum()

    @staticmethod
    def backward(ctx: Any, grad_out: Tensor) -> Any:
        index, *places, sh, frame, albedo, roughness, _, _, visibility, indirect, environment, _ = ctx.saved_tensors
        # Rows of surfels that were not chosen stay zero.
        none = sh.new_empty(0)
        own = [torch.zeros_like(value) if ctx.wants_physical else none for value in (frame, albedo, roughness)]
        to_sh = torch.zeros_like(sh) if ctx.wants_own else none
        wants_incident = ctx.wants_physical and ctx.wants_incident
        incident = incident_gradients(visibility, indirect, sh, wants_incident)
        wants_light = ctx.wants_physical and ctx.wants_environment
        light = light_gradient(environment, sh, wants_light)
        flags = (ctx.wants_own, ctx.wants_physical, wants_incident, wants_light, ctx.keeps_light)
        arguments = [
            *ctx.given, index, *places, sh.shape[1], sh, ctx.slopes, ctx.lights, grad_out.contiguous(),
            *map(int, flags), *own, to_sh, *incident,
        ]  # fmt: skip
        launch_in_parallel(ctx.kernels.backward, len(index), sh.device, arguments, light)
        materials = own if ctx.wants_physical else 3 * [None]
        traced = incident if wants_incident else 2 * [None]
        harmonics = to_sh if ctx.wants_own else None
        to_light = light.total()[0][..., :3] if wants_light else None
        return 6 * (None,) + (harmonics, *materials, None, None, *traced, to_light, None)


@cache
def consistency_kernels(dtype: torch.dtype, on_cuda: bool) -> Pair:
    """The kernels of L_rad for a scalar type and a division of work.

    An item is one of the surfels ``index``; its samples are in the item's row, its values in the surfel's row.
    """
    words, arrays = shading_words(dtype, on_cuda, "total"), flat(dtype)
    make = partial(native_kernel, CONSISTENCY, dtype, NATIVE, on_cuda=on_cuda, words=words)
    sides = (
        *inputs_of(dtype),
        (LONGS, "index"),
        (arrays, "camera drawn centre"),
        (wp.int32, "coefficients"),
        (arrays, "sh"),
    )
    forward = (scalar_type(dtype), "scale"), (wp.int32, "keeps_light"), (arrays, "losses slopes lights")
    backward = (
        (arrays, "slopes lights pulls"),
        (wp.int32, "wants_own wants_physical wants_incident wants_environment has_light"),
        (arrays, "grad_normal grad_albedo grad_roughness grad_sh grad_visibility grad_indirect grad_environment"),
    )
    return Pair(make("forward", "surfel", *sides, *forward), make("backward", "surfel", *sides, *backward))
