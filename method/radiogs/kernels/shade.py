"""K3: the Monte-Carlo sum of Eq. 8 over cached incident light, fused, with gradient."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from .counters import count
from .runtime import as_array, launch_in_parallel, workers
from .shade_source import shade_kernels


def shade(
    normal: Float[Tensor, "surfels 3"],
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    outgoing: Float[Tensor, "surfels views 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    visibility: Float[Tensor, "surfels samples"],
    indirect: Float[Tensor, "surfels samples 3"],
    environment: Float[Tensor, "height width 3"],
) -> Float[Tensor, "surfels views 4 3"]:
    """Outgoing radiance of each surfel towards its views, linear RGB, in four parts.

    The parts are diffuse direct, diffuse indirect, specular direct, specular indirect: sums over the samples of
    weight f(wo, wi) (n.wi)+ times V Env(wi) or L_ind. ``outgoing`` and ``direction`` are unit, in the world, away
    from the surface; ``weight`` in steradian; ``environment`` lat-long radiance (see ``light``), looked up
    bilinearly. Zero where a view is below the surface.

    Gradients: normal, albedo, roughness, visibility, indirect, environment. Directions, weights and views are
    made without gradient, and get none.
    """
    return _Shade.apply(normal, albedo, roughness, outgoing, direction, weight, visibility, indirect, environment)


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        inputs = tuple(value.detach().contiguous() for value in inputs)
        outgoing, direction = inputs[3], inputs[4]
        kernels = shade_kernels(outgoing.dtype)
        surfels, views = outgoing.shape[:2]
        out = outgoing.new_empty(surfels, views, 4, 3)
        given, result = _inputs(kernels, inputs), as_array(out, dtype=kernels.vector)
        launch_in_parallel(kernels.forward, surfels, out.device, lambda _: [given, result])
        count(shaded_samples=surfels * views * direction.shape[1])
        ctx.save_for_backward(*inputs)
        return out

    @staticmethod
    def backward(ctx: Any, grad_out: Tensor) -> Any:
        inputs = ctx.saved_tensors
        normal, albedo, roughness, _, _, _, visibility, indirect, environment = inputs
        kernels = shade_kernels(normal.dtype)
        wants_incident = ctx.needs_input_grad[6] or ctx.needs_input_grad[7]
        wants_environment = ctx.needs_input_grad[8]
        team = workers(normal.device)
        own = [torch.empty_like(value) for value in (normal, albedo, roughness)]
        incident = [torch.zeros_like(value if wants_incident else value[:0]) for value in (visibility, indirect)]
        light = environment.new_zeros(team, *environment.shape)
        given = _inputs(kernels, inputs)
        upstream = as_array(grad_out.contiguous(), dtype=kernels.vector)
        outputs = [
            as_array(own[0], dtype=kernels.vector), as_array(own[1], dtype=kernels.vector),
            as_array(own[2]), as_array(incident[0]), as_array(incident[1], dtype=kernels.vector),
        ]  # fmt: skip
        lights = [as_array(buffer, dtype=kernels.vector) for buffer in light]
        flags = [int(wants_incident), int(wants_environment)]
        launch_in_parallel(
            kernels.backward,
            len(normal),
            normal.device,
            lambda worker: [given, upstream, *flags, *outputs, lights[worker]],
        )
        traced = incident if wants_incident else [None, None]
        return *own, None, None, None, *traced, light.sum(0) if wants_environment else None


def _inputs(kernels: Any, inputs: Any) -> Any:
    given = kernels.Inputs()
    names = (
        "normal", "albedo", "roughness", "outgoing", "direction", "weight", "visibility", "indirect", "environment",
    )  # fmt: skip
    for name, value in zip(names, inputs, strict=True):
        is_scalar = name in ("roughness", "weight", "visibility")
        setattr(given, name, as_array(value) if is_scalar else as_array(value, dtype=kernels.vector))
    return given
