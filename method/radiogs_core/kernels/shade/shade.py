"""K3: the Monte-Carlo sum of Eq. 8 over incident light; fused and differentiable.

With s = wo + wi along the half-vector and F, V and D the terms of ``brdf``, each sample adds

    weight (n.wi) { albedo / pi, D F V } x { visibility Env(wi), L_ind }

to the four sums, or to their total. The backward pass evaluates the same terms again instead of storing them.

Kernels process samples in blocks of LANES, which are vectors by their type (one sample at a time, with the library's
atan2 and pow, measured 4 times slower). Arranged for CUDA, the same text has one lane. A lane without a sample, or with
a sample below the horizon, uses the normal as its direction and weight zero, so its terms are finite and contribute
zero.
"""

from functools import cache, partial
from itertools import repeat
from typing import Any, Literal

import torch
import warp as wp
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ...instruments import count
from ..arguments import MOST_ENTRIES
from ..arrangement import an_item, as_on_cuda
from ..lanes import LANES
from ..native_kernel import INTEGERS, LONGS, Pair, flat, native_file, native_kernel
from ..runtime import NATIVE, WorkerSums, launch_in_parallel
from .brdf import FRESNEL_NORMAL
from .lookup import ANGLE, ATAN_TERMS

SHADE = native_file(__package__, "shade.inl", LANES, ANGLE)

LANES_ON_CPU = 16
"""Samples in a block on the CPU; the shuffles of ``shade.inl`` are written for 16."""

EXP_TERMS = {torch.float32: 8, torch.float64: 15}
"""Number of terms of exp's series, for arguments down to -0.55, that reach the last digit of each type."""

TEXEL = 4
"""Numbers of a texel of the light in memory: three channels and one for padding, so that it is a vector of four."""

SAMPLE_FIELDS = 8
"""Numbers of a sample in memory: direction (3), weight, visibility, indirect radiance (3)."""

OF_SAMPLES, ENVIRONMENT = (4, 5, 6, 7), 8
"""Places, among the tensors of ``shade``, of values of samples, and of the light."""

Kind = Literal["parts", "total", "given"]
"""The sums of ``shade_kernels``. "parts": the four sums, from normals. "total": the sum of them all, from frames, whose
third columns are normals. "given": the total, with V Env + L_ind of each sample given."""


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
    direction: Float[Tensor, "rows samples 3"],
    weight: Float[Tensor, "rows samples"],
    visibility: Float[Tensor, "rows samples"] | None,
    indirect: Float[Tensor, "rows samples 3"],
    environment: Float[Tensor, "height width 3"] | None,
    specular_at: Bool[Tensor, " surfels"] | None = None,
) -> Float[Tensor, "rows views 3"]:
    """The sum of the four parts of ``shade``, whose arguments it takes except these.

    Args:
        frame: Rotation matrices; their third columns are the unit normals.
        direction: As of ``shade``, in one row for each set of a surfel's samples: as many sets of every surfel, which
            follow one another. The other values of samples are in the same rows.
        visibility: V along each direction; None, as ``environment``, if ``indirect`` is the radiance of ``arrive``.
    """
    inputs = (frame, albedo, roughness, outgoing, direction, weight, visibility, indirect, environment, specular_at)
    return _in_parts("given" if environment is None else "total", inputs)


def _in_parts(kind: Kind, inputs: tuple[Tensor | None, ...]) -> Tensor:
    """The sums of all rows, in as many launches as the kernels' counts need."""
    outgoing, weight = inputs[3], inputs[5]
    assert outgoing is not None
    assert weight is not None
    sets = sets_of(outgoing, weight)
    together = max(1, MOST_ENTRIES // (sets * max(3 * weight.shape[1], 12 * outgoing.shape[1])))
    if len(outgoing) <= together:
        return _Shade.apply(kind, *inputs)
    rows = [together, sets * together]
    split = [
        repeat(value) if value is None or place == ENVIRONMENT else value.split(rows[place in OF_SAMPLES])
        for place, value in enumerate(inputs)
    ]
    return torch.cat([_Shade.apply(kind, *part) for part in zip(*split, strict=False)])


def sets_of(outgoing: Tensor | None, rows: Tensor) -> int:
    """Number of rows of samples that each surfel has; 1 where each row names its surfel."""
    return len(rows) // len(outgoing) if outgoing is not None and len(outgoing) else 1


class _Shade(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, kind: Kind, *inputs: Tensor | None) -> Tensor:
        inputs = tuple(None if value is None else value.contiguous() for value in inputs)
        outgoing, direction, specular_at = inputs[3], inputs[4], inputs[9]
        assert outgoing is not None
        assert direction is not None
        kernels = shade_kernels(outgoing.dtype, as_on_cuda(outgoing.device), kind)
        rows, views = len(direction), outgoing.shape[1]
        out = outgoing.new_empty((rows, views, 4, 3) if kind == "parts" else (rows, views, 3))
        given = shading_inputs(inputs)
        launch_in_parallel(kernels.forward, rows, out.device, [*given, out])
        count_samples(views, direction, specular_at)
        ctx.kind, ctx.given, ctx.sets = kind, given, sets_of(outgoing, direction)
        ctx.save_for_backward(*inputs)
        return out

    @staticmethod
    def backward(ctx: Any, grad_out: Tensor) -> Any:
        normal, albedo, roughness, _, _, _, visibility, indirect, environment, _ = ctx.saved_tensors
        kernels = shade_kernels(normal.dtype, as_on_cuda(normal.device), ctx.kind)
        wants_incident = ctx.needs_input_grad[7] or ctx.needs_input_grad[8]
        rows = ctx.sets * len(normal)
        own = [value.new_empty(rows, *value.shape[1:]) for value in (albedo, roughness)]
        to_normal = normal.new_empty(rows, 3) if ctx.kind == "parts" else normal.new_zeros(rows, 3, 3)
        incident = incident_gradients(visibility, indirect, normal, wants_incident)
        wants_light = ctx.needs_input_grad[9] and environment is not None
        light = light_gradient(environment, normal, wants_light)
        flags = [int(wants_incident), int(wants_light)]
        arguments = [*ctx.given, grad_out.contiguous(), *flags, to_normal, *own, *incident]
        launch_in_parallel(kernels.backward, rows, normal.device, arguments, light)
        traced = incident if wants_incident else [None, None]
        to_light = light.total()[0][..., :3] if wants_light else None
        if ctx.sets > 1:
            to_normal, *own = (each.unflatten(0, (-1, ctx.sets)).sum(1) for each in (to_normal, *own))
        return None, to_normal, *own, None, None, None, *traced, to_light, None


def light_gradient(environment: Tensor | None, like: Tensor, wanted: bool) -> WorkerSums:
    """Memory for the gradient to a light's texels, TEXEL numbers each; empty unless it is wanted."""
    shape = (*environment.shape[:2], TEXEL) if wanted and environment is not None else (0,)
    return WorkerSums([like.new_empty(shape)], like.device)


def incident_gradients(visibility: Tensor | None, indirect: Tensor, like: Tensor, wanted: bool) -> list[Tensor]:
    """Memory for the gradients to V and L_ind; empty unless they are wanted."""
    if wanted and visibility is not None:
        return [torch.empty_like(visibility), torch.empty_like(indirect)]
    return 2 * [like.new_empty(0)]


def count_samples(views: int, direction: Tensor, specular_at: Tensor | None) -> None:
    """Count the shaded samples, the evaluated lobes and the bytes read."""
    samples = views * direction.shape[:2].numel()
    lobes = samples if specular_at is None else specular_at.sum() * (samples // max(1, len(specular_at)))
    count(shaded_samples=samples, lobes=lobes, bytes_read=samples * SAMPLE_FIELDS * direction.element_size())


def shading_inputs(inputs: tuple[Tensor | None, ...]) -> list[Any]:
    """The values of the parameters ``inputs_of`` from the tensors of ``shade``, contiguous; None for an absent one."""
    outgoing, direction, environment, specular_at = inputs[3], inputs[4], inputs[8], inputs[9]
    assert direction is not None
    views, size = 0 if outgoing is None else outgoing.shape[1], (0, 0) if environment is None else environment.shape[:2]
    texels = None if environment is None else torch.nn.functional.pad(environment, (0, TEXEL - 3))
    lobes = None if specular_at is None else specular_at.int()
    sets = sets_of(outgoing, direction)
    return [views, sets, direction.shape[1], *size, int(specular_at is None), *inputs[:8], texels, lobes]


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
    given = shading_inputs(tuple(None if value is None else value.contiguous() for value in inputs))
    kernel = arrival_kernel(into.dtype, as_on_cuda(into.device))
    launch_in_parallel(kernel, len(index), into.device, [*given, index, into])


def inputs_of(dtype: torch.dtype) -> tuple[tuple[Any, str], ...]:
    """The parameters that all kernels of shading begin with; see ``shading_inputs``."""
    return (
        (wp.int32, "given_views given_sets given_samples given_height given_width given_lobes_everywhere"),
        (flat(dtype), "given_normal given_albedo given_roughness given_outgoing given_direction given_weight"),
        (flat(dtype), "given_visibility given_indirect given_environment"),
        (INTEGERS, "given_specular_at"),
    )


_ALL_TOGETHER = {"CHANNELS": 3, "VIEW": 3, "SPECULAR": 0, "KNOWN": 0}
_FRAMES = {"NORMAL_STRIDE": 9, "NORMAL_STEP": 3, "NORMAL_FIRST": 2}

_WORDS: dict[Kind, dict[str, int]] = {
    "parts": {
        "CHANNELS": 6, "VIEW": 12, "SPECULAR": 6, "KNOWN": 0, "NORMAL_STRIDE": 3, "NORMAL_STEP": 1, "NORMAL_FIRST": 0
    },
    "total": {**_ALL_TOGETHER, **_FRAMES},
    "given": {**_ALL_TOGETHER, "KNOWN": 1, **_FRAMES},
}  # fmt: skip
"""Channels of incident radiance, numbers of a view and the first of them that is specular, whether the incident
radiance is known, and the offset of a normal's numbers."""


def shading_words(dtype: torch.dtype, on_cuda: bool, kind: Kind) -> dict[str, object]:
    """The values of the words in ``SHADE``."""
    return {
        "SAMPLES_IN_A_BLOCK": an_item(on_cuda, LANES_ON_CPU),
        "ATAN_TERMS": ATAN_TERMS[dtype],
        "EXP_TERMS": EXP_TERMS[dtype],
        "F0": FRESNEL_NORMAL,
        "TEXEL": TEXEL,
        **_WORDS[kind],
    }


@cache
def shade_kernels(dtype: torch.dtype, on_cuda: bool, kind: Kind = "parts") -> Pair:
    """The kernels of the sums for a scalar type and a division of work; an item is a row of a surfel's samples."""
    words, arrays = shading_words(dtype, on_cuda, kind), flat(dtype)
    make = partial(native_kernel, SHADE, dtype, NATIVE, on_cuda=on_cuda, words=words)
    pulls = (
        (arrays, "pulls"),
        (wp.int32, "wants_incident wants_environment"),
        (arrays, "grad_normal grad_albedo grad_roughness grad_visibility grad_indirect grad_environment"),
    )
    given = inputs_of(dtype)
    return Pair(make("forward", "surfel", *given, (arrays, "out")), make("backward", "surfel", *given, *pulls))


@cache
def arrival_kernel(dtype: torch.dtype, on_cuda: bool) -> wp.Kernel:
    """The kernel that writes V Env + L_ind of the samples of some surfels to rows ``index``."""
    parameters = *inputs_of(dtype), (LONGS, "index"), (flat(dtype), "arriving")
    words = shading_words(dtype, on_cuda, "total")
    return native_kernel(SHADE, dtype, NATIVE, "arrive", "surfel", *parameters, on_cuda=on_cuda, words=words)
