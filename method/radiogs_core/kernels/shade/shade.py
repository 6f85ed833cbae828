"""K3: the Monte-Carlo sum of Eq. 8 over incident light; fused and differentiable."""

from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from ...instruments import count
from ..arguments import MOST_ENTRIES, Struct
from ..arrangement import as_on_cuda
from ..runtime import launch_in_parallel, workers
from .shade_source import TEXEL, shade_kernels

SAMPLE_FIELDS = 8
"""Numbers of a sample in memory: direction (3), weight, visibility, indirect radiance (3)."""


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
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "surfels views 4 3"]:
    """Outgoing radiance of each surfel towards its views, linear RGB, in four parts.

    The parts are diffuse direct, diffuse indirect, specular direct and specular indirect: sums over the samples of
    weight f(wo, wi) (n.wi)+ times V Env(wi) or L_ind. They are zero for a view below the surface. Gradients flow to
    normal, albedo, roughness, visibility, indirect and environment.

    Surfels are processed in as many launches as the kernels' 32-bit counts need: 2 million surfels with 384 samples
    take two.

    Args:
        normal: Unit normals in the world.
        albedo: Linear diffuse albedo.
        roughness: Perceptual roughness.
        outgoing: Unit directions in the world from the surfel to its views.
        direction: Unit directions in the world from the surfel towards the light.
        weight: Solid angle of each direction, in steradian.
        visibility: V along each direction.
        indirect: L_ind along each direction, linear RGB.
        environment: Distant light, linear RGB, lat-long (see ``light``), looked up bilinearly.
        specular_at: Whether each surfel has specular parts (None: all); for others they are zero and not evaluated.
    """
    if specular_at is None:
        specular_at = torch.ones(len(normal), dtype=torch.bool, device=normal.device)
    together = max(1, MOST_ENTRIES // max(3 * direction.shape[1], 12 * outgoing.shape[1]))
    of_surfels = (normal, albedo, roughness, outgoing, direction, weight, visibility, indirect)
    parts = zip(*(value.split(together) for value in (*of_surfels, specular_at)), strict=True)
    shaded = [_Shade.apply(*part[:-1], environment, part[-1]) for part in parts]
    return shaded[0] if len(shaded) == 1 else torch.cat(shaded)


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> Tensor:
        inputs = tuple(value.detach().contiguous() for value in inputs)
        outgoing, direction, specular_at = inputs[3], inputs[4], inputs[9]
        kernels = shade_kernels(outgoing.dtype, as_on_cuda(outgoing.device))
        surfels, views = outgoing.shape[:2]
        out = outgoing.new_empty(surfels, views, 4, 3)
        given = _inputs(kernels, inputs)
        launch_in_parallel(kernels.forward, surfels, out.device, lambda _: [given, out])
        samples = surfels * views * direction.shape[1]
        lobes = specular_at.sum() * views * direction.shape[1]
        count(shaded_samples=samples, lobes=lobes, bytes_read=samples * SAMPLE_FIELDS * out.element_size())
        ctx.given = given
        ctx.save_for_backward(*inputs)
        return out

    @staticmethod
    def backward(ctx: Any, grad_out: Tensor) -> Any:
        inputs = ctx.saved_tensors
        normal, albedo, roughness, _, _, _, visibility, indirect, environment, _ = inputs
        kernels = shade_kernels(normal.dtype, as_on_cuda(normal.device))
        wants_incident = ctx.needs_input_grad[6] or ctx.needs_input_grad[7]
        wants_environment = ctx.needs_input_grad[8]
        own = [torch.empty_like(value) for value in (normal, albedo, roughness)]
        incident = [torch.empty_like(value if wants_incident else value[:0]) for value in (visibility, indirect)]
        # Each worker adds to a map of its own; they are summed in a fixed order, so the gradient repeats bit for bit.
        team = workers(normal.device) if wants_environment else 0
        light = environment.new_zeros(team, *environment.shape[:2], TEXEL)
        lights = list(light) or [light] * workers(normal.device)
        given, pull = ctx.given, grad_out.contiguous()
        launch_in_parallel(
            kernels.backward,
            len(normal),
            normal.device,
            lambda worker: [given, pull, int(wants_incident), int(wants_environment), *own, *incident, lights[worker]],
        )
        traced = incident if wants_incident else [None, None]
        return *own, None, None, None, *traced, light.sum(0)[..., :3] if wants_environment else None, None


def _inputs(kernels: Any, inputs: Any) -> Struct:
    *of_surfels, environment, specular_at = inputs
    names = ("normal", "albedo", "roughness", "outgoing", "direction", "weight", "visibility", "indirect")
    return Struct(
        kernels.Inputs,
        **dict(zip(names, of_surfels, strict=True)),
        environment=torch.nn.functional.pad(environment, (0, TEXEL - 3)),
        specular_at=specular_at.int(),
        views=inputs[3].shape[1],
        samples=inputs[4].shape[1],
        height=environment.shape[0],
        width=environment.shape[1],
    )
