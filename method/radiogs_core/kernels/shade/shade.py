"""K3: the Monte-Carlo sum of Eq. 8 over incident light, and L_rad; fused and differentiable."""

from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ...instruments import count
from ..arguments import MOST_ENTRIES, Struct
from ..arrangement import as_on_cuda
from ..runtime import WorkerSums, launch_in_parallel
from .shade_source import TEXEL, Kind, arrival_kernel, consistency_kernels, shade_kernels

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
    inputs = (normal, albedo, roughness, outgoing, direction, weight, visibility, indirect, environment, specular_at)
    return _in_parts("parts", inputs)


def shade_total(
    frame: Float[Tensor, "surfels 3 3"],
    albedo: Float[Tensor, "surfels 3"],
    roughness: Float[Tensor, " surfels"],
    outgoing: Float[Tensor, "surfels views 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    visibility: Float[Tensor, "surfels samples"] | None,
    indirect: Float[Tensor, "surfels samples 3"],
    environment: Float[Tensor, "height width 3"] | None,
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "surfels views 3"]:
    """The sum of the four parts of ``shade``, whose arguments it takes but for these.

    Args:
        frame: Rotation matrices; their third columns are the unit normals.
        visibility: V along each direction; None, as ``environment``, if ``indirect`` is the radiance of ``arrive``.
    """
    inputs = (frame, albedo, roughness, outgoing, direction, weight, visibility, indirect, environment, specular_at)
    return _in_parts("given" if environment is None else "total", inputs)


def _in_parts(kind: Kind, inputs: tuple[Tensor | None, ...]) -> Tensor:
    """The sums of all surfels, in as many launches as the kernels' counts need."""
    of_surfels, environment = (*inputs[:8], inputs[9]), inputs[8]
    outgoing, weight = inputs[3], inputs[5]
    assert outgoing is not None
    assert weight is not None
    together = max(1, MOST_ENTRIES // max(3 * weight.shape[1], 12 * outgoing.shape[1]))
    if len(weight) <= together:
        return _Shade.apply(kind, *inputs)
    pieces = len(range(0, len(weight), together))
    split = (pieces * (None,) if value is None else value.split(together) for value in of_surfels)
    return torch.cat([_Shade.apply(kind, *part[:-1], environment, part[-1]) for part in zip(*split, strict=True)])


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, kind: Kind, *inputs: Tensor | None) -> Tensor:
        inputs = tuple(None if value is None else value.contiguous() for value in inputs)
        outgoing, direction, specular_at = inputs[3], inputs[4], inputs[9]
        assert outgoing is not None
        assert direction is not None
        kernels = shade_kernels(outgoing.dtype, as_on_cuda(outgoing.device), kind)
        surfels, views = outgoing.shape[:2]
        out = outgoing.new_empty((surfels, views, 4, 3) if kind == "parts" else (surfels, views, 3))
        given = _inputs(kernels, inputs)
        launch_in_parallel(kernels.forward, surfels, out.device, lambda _: [given, out])
        _count(surfels, views, direction, specular_at)
        ctx.kind, ctx.given = kind, given
        ctx.save_for_backward(*inputs)
        return out

    @staticmethod
    def backward(ctx: Any, grad_out: Tensor) -> Any:
        normal, albedo, roughness, _, _, _, visibility, indirect, environment, _ = ctx.saved_tensors
        kernels = shade_kernels(normal.dtype, as_on_cuda(normal.device), ctx.kind)
        wants_incident = ctx.needs_input_grad[7] or ctx.needs_input_grad[8]
        own = [torch.empty_like(albedo), torch.empty_like(roughness)]
        to_normal = torch.empty_like(normal) if ctx.kind == "parts" else torch.zeros_like(normal)
        incident = _incident_gradients(visibility, indirect, normal, wants_incident)
        light = _LightGradient(environment, normal, ctx.needs_input_grad[9])
        flags = [int(wants_incident), int(light.wanted)]
        arguments = [ctx.given, grad_out.contiguous(), *flags, to_normal, *own, *incident]
        launch_in_parallel(kernels.backward, len(normal), normal.device, lambda worker: [*arguments, light.of(worker)])
        traced = incident if wants_incident else [None, None]
        return None, to_normal, *own, None, None, None, *traced, light.total(), None


class _LightGradient:
    """The gradient to a light's texels. Each worker adds to a map of its own, so that it repeats bit for bit."""

    def __init__(self, environment: Tensor | None, like: Tensor, wanted: bool) -> None:
        self.wanted = wanted and environment is not None
        shape = (*environment.shape[:2], TEXEL) if self.wanted and environment is not None else (0,)
        self.sums = WorkerSums([like.new_empty(shape)], like.device)

    def of(self, worker: int) -> Tensor:
        """The map that a worker adds to; an empty one if no gradient is wanted."""
        return self.sums.of(worker)[0] if self.wanted else self.sums.like[0]

    def total(self) -> Tensor | None:
        """The sum over all workers, [height, width, 3]; None if no gradient is wanted."""
        return self.sums.total()[0][..., :3] if self.wanted else None


def _incident_gradients(visibility: Tensor | None, indirect: Tensor, like: Tensor, wanted: bool) -> list[Tensor]:
    """Memory for the gradients to V and L_ind; empty unless they are wanted."""
    if wanted and visibility is not None:
        return [torch.empty_like(visibility), torch.empty_like(indirect)]
    return 2 * [like.new_empty(0)]


def _count(surfels: int, views: int, direction: Tensor, specular_at: Tensor | None) -> None:
    each = views * direction.shape[1]
    lobes = surfels * each if specular_at is None else specular_at.sum() * each
    read = surfels * each * SAMPLE_FIELDS * direction.element_size()
    count(shaded_samples=surfels * each, lobes=lobes, bytes_read=read)


def _inputs(kernels: Any, inputs: Any) -> Struct:
    *of_surfels, environment, specular_at = inputs
    names = ("normal", "albedo", "roughness", "outgoing", "direction", "weight", "visibility", "indirect")
    outgoing, direction = inputs[3], inputs[4]
    height, width = (0, 0) if environment is None else environment.shape[:2]
    return Struct(
        kernels.Inputs,
        **dict(zip(names, of_surfels, strict=True)),
        environment=None if environment is None else torch.nn.functional.pad(environment, (0, TEXEL - 3)),
        specular_at=None if specular_at is None else specular_at.int(),
        lobes_everywhere=int(specular_at is None),
        views=0 if outgoing is None else outgoing.shape[1],
        samples=direction.shape[1],
        height=height,
        width=width,
    )


@torch.no_grad()
def arrive(
    into: Float[Tensor, "surfels samples 3"],
    index: Int[Tensor, " chosen"],
    direction: Float[Tensor, "chosen samples 3"],
    visibility: Float[Tensor, "chosen samples"],
    indirect: Float[Tensor, "chosen samples 3"],
    environment: Float[Tensor, "height width 3"],
) -> None:
    """Write V Env + L_ind of the samples of some surfels, linear RGB, to the rows ``index`` of ``into``.

    A sample's value depends on nothing but the sample and the light, to the bit. ``into``: contiguous memory. The other
    arguments: see ``shade``.
    """
    inputs = (None, None, None, None, direction, None, visibility, indirect, environment, None)
    kernels = arrival_kernel(into.dtype, as_on_cuda(into.device))
    given = _inputs(kernels, tuple(None if value is None else value.contiguous() for value in inputs))
    launch_in_parallel(kernels.arrive, len(index), into.device, lambda _: [given, index, into])


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
        kernels = consistency_kernels(sh.dtype, as_on_cuda(sh.device))
        given = _inputs(kernels, (*shaded[:3], None, *shaded[3:]))
        needs = ctx.needs_input_grad
        ctx.wants_own, ctx.wants_physical = own_learns and needs[6], physical_learns and any(needs[7:])
        ctx.wants_incident, ctx.wants_environment = needs[12] or needs[13], needs[14]
        # The light's derivative needs the places of its texels, so that what was found there need not be kept.
        ctx.keeps_light = ctx.wants_physical and not ctx.wants_environment
        chosen = len(index)
        losses, slopes = sh.new_empty(chosen), sh.new_empty(chosen, 2, 2, 3)
        lights = torch.empty_like(direction) if ctx.keeps_light else losses[:0]
        scale = 1 / max(1, 3 * chosen)
        arguments = [given, index, *places, sh.shape[1], sh, scale, int(ctx.keeps_light), losses, slopes, lights]
        launch_in_parallel(kernels.forward, chosen, sh.device, lambda _: arguments)
        _count(chosen, 2, direction, None if specular_at is None else specular_at[index])
        ctx.kernels, ctx.given, ctx.slopes, ctx.lights = kernels, given, slopes, lights
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
        incident = _incident_gradients(visibility, indirect, sh, wants_incident)
        light = _LightGradient(environment, sh, ctx.wants_physical and ctx.wants_environment)
        flags = (ctx.wants_own, ctx.wants_physical, wants_incident, light.wanted, ctx.keeps_light)
        arguments = [
            ctx.given, index, *places, sh.shape[1], sh, ctx.slopes, ctx.lights, grad_out.contiguous(),
            *map(int, flags), *own, to_sh, *incident,
        ]  # fmt: skip
        launch_in_parallel(ctx.kernels.backward, len(index), sh.device, lambda worker: [*arguments, light.of(worker)])
        materials = own if ctx.wants_physical else 3 * [None]
        traced = incident if wants_incident else 2 * [None]
        harmonics = to_sh if ctx.wants_own else None
        return 6 * (None,) + (harmonics, *materials, None, None, *traced, light.total(), None)
