"""Kernels for shading: one item a surfel, a loop over its samples and views, forward and backward.

With s = wo + wi along the half-vector and F, V and D the terms of ``brdf``, each sample adds

    weight (n.wi) { albedo / pi, D F V } x { visibility Env(wi), L_ind }

to the four sums, or to their total. The backward pass evaluates the same terms again instead of storing them. L_rad
(``consistency_kernels``) is the sums of two views, and their distance from the surfel's own radiance.

All passes are native snippets that process samples in blocks of LANES, which are vectors by their type (one sample at a
time, with the library's atan2 and pow, measured 4 times slower). Arranged for CUDA, the same text has one lane. A lane
without a sample, or with a sample below the horizon, uses the normal as its direction and weight zero, so its terms are
finite and contribute zero.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any, Literal

import torch
import warp as wp

from ..lanes import LANES
from ..native_text import native_file, native_text
from ..runtime import NATIVE, scalar_type, start_warp
from ..surfel.harmonics_source import HARMONICS
from .angle import ANGLE, ATAN_TERMS
from .brdf import FRESNEL_NORMAL

_TEXT = native_file(__package__, "shade.inl", lanes=LANES, angle=ANGLE, harmonics=HARMONICS)

LANES_ON_CPU = 16
"""Samples in a block on the CPU; the shuffles of ``shade.inl`` are written for 16."""

EXP_TERMS = {torch.float32: 8, torch.float64: 15}
"""Number of terms of exp's series, for arguments down to -0.55, that reach the last digit of each type."""

TEXEL = 4
"""Numbers of a texel of the light in memory: three channels and one for padding, so that it is a vector of four."""

Kind = Literal["parts", "total", "given"]
"""The sums of ``shade_kernels``. "parts": the four sums, from normals. "total": the sum of them all, from
frames, whose third columns are normals. "given": the same, where V Env + L_ind of each sample is given."""

_ALL_TOGETHER = {
    "CHANNELS": "3", "VIEW": "3", "SPECULAR": "0", "KNOWN": "0",
    "NORMAL_STRIDE": "9", "NORMAL_STEP": "3", "NORMAL_FIRST": "2",
}  # fmt: skip

_WORDS: dict[Kind, dict[str, str]] = {
    "parts": {
        "CHANNELS": "6", "VIEW": "12", "SPECULAR": "6", "KNOWN": "0",
        "NORMAL_STRIDE": "3", "NORMAL_STEP": "1", "NORMAL_FIRST": "0",
    },
    "total": _ALL_TOGETHER,
    "given": {**_ALL_TOGETHER, "KNOWN": "1"},
}  # fmt: skip
"""Channels of incident radiance, numbers of a view and the first of them that is specular, whether the incident
radiance is known, and where the numbers of a normal lie."""


@cache
def inputs_struct(dtype: torch.dtype) -> Any:
    """The struct of what all kernels of shading read, for a scalar type; all arrays are flat."""
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))

    @wp.struct
    class Inputs:
        views: wp.int32
        samples: wp.int32
        height: wp.int32
        width: wp.int32
        lobes_everywhere: wp.int32
        normal: flat
        albedo: flat
        roughness: flat
        outgoing: flat
        direction: flat
        weight: flat
        visibility: flat
        indirect: flat
        environment: flat
        specular_at: wp.array(dtype=wp.int32)

    return Inputs


@cache
def shade_kernels(dtype: torch.dtype, on_cuda: bool, kind: Kind = "parts") -> Any:
    """The pair ``forward``, ``backward`` for a scalar type; all arrays are flat."""
    Inputs = inputs_struct(dtype)
    flat = wp.array(dtype=scalar_type(dtype))

    @wp.func_native(_written_for("forward", dtype, on_cuda, kind))
    def shade_surfel(surfel: wp.int32, given: Inputs, out: flat): ...

    @wp.func_native(_written_for("backward", dtype, on_cuda, kind))
    def pull_surfel(
        surfel: wp.int32,
        given: Inputs,
        pulls: flat,
        wants_incident: wp.int32,
        wants_environment: wp.int32,
        grad_normal: flat,
        grad_albedo: flat,
        grad_roughness: flat,
        grad_visibility: flat,
        grad_indirect: flat,
        grad_environment: flat,
    ): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(begin: wp.int32, given: Inputs, out: flat):
        shade_surfel(begin + wp.tid(), given, out)

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32,
        given: Inputs,
        pulls: flat,
        wants_incident: wp.int32,
        wants_environment: wp.int32,
        grad_normal: flat,
        grad_albedo: flat,
        grad_roughness: flat,
        grad_visibility: flat,
        grad_indirect: flat,
        grad_environment: flat,
    ):
        pull_surfel(
            begin + wp.tid(), given, pulls, wants_incident, wants_environment,
            grad_normal, grad_albedo, grad_roughness, grad_visibility, grad_indirect, grad_environment,
        )  # fmt: skip

    return SimpleNamespace(Inputs=Inputs, forward=forward, backward=backward)


@cache
def arrival_kernel(dtype: torch.dtype, on_cuda: bool) -> Any:
    """``arrive`` for a scalar type: V Env + L_ind of the samples of some surfels, into rows ``index``."""
    Inputs = inputs_struct(dtype)
    flat, rows = wp.array(dtype=scalar_type(dtype)), wp.array(dtype=wp.int64)

    @wp.func_native(_written_for("arrive", dtype, on_cuda, "total"))
    def add_up(surfel: wp.int32, given: Inputs, index: rows, arriving: flat): ...

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def arrive(begin: wp.int32, given: Inputs, index: rows, arriving: flat):
        add_up(begin + wp.tid(), given, index, arriving)

    return SimpleNamespace(Inputs=Inputs, arrive=arrive)


@cache
def consistency_kernels(dtype: torch.dtype, on_cuda: bool) -> Any:
    """The pair ``forward``, ``backward`` of L_rad for a scalar type; all arrays are flat.

    An item is one of the surfels ``index``; its samples are in the item's row, its values in that of the surfel.
    """
    Inputs = inputs_struct(dtype)
    scalar = scalar_type(dtype)
    flat, rows = wp.array(dtype=scalar), wp.array(dtype=wp.int64)

    @wp.func_native(_written_for("consistency", dtype, on_cuda, "total"))
    def compare(
        surfel: wp.int32, given: Inputs, index: rows, camera: flat, drawn: flat, centre: flat,
        coefficients: wp.int32, sh: flat, scale: scalar, keeps_light: wp.int32,
        losses: flat, slopes: flat, lights: flat,
    ): ...  # fmt: skip

    @wp.func_native(_written_for("pull_consistency", dtype, on_cuda, "total"))
    def pull_apart(
        surfel: wp.int32, given: Inputs, index: rows, camera: flat, drawn: flat, centre: flat,
        coefficients: wp.int32, sh: flat, slopes: flat, lights: flat, pulls: flat,
        wants_own: wp.int32, wants_physical: wp.int32, wants_incident: wp.int32, wants_environment: wp.int32,
        has_light: wp.int32, grad_normal: flat, grad_albedo: flat, grad_roughness: flat, grad_sh: flat,
        grad_visibility: flat, grad_indirect: flat, grad_environment: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def forward(
        begin: wp.int32, given: Inputs, index: rows, camera: flat, drawn: flat, centre: flat,
        coefficients: wp.int32, sh: flat, scale: scalar, keeps_light: wp.int32,
        losses: flat, slopes: flat, lights: flat,
    ):  # fmt: skip
        compare(
            begin + wp.tid(), given, index, camera, drawn, centre, coefficients, sh, scale, keeps_light,
            losses, slopes, lights,
        )  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def backward(
        begin: wp.int32, given: Inputs, index: rows, camera: flat, drawn: flat, centre: flat,
        coefficients: wp.int32, sh: flat, slopes: flat, lights: flat, pulls: flat,
        wants_own: wp.int32, wants_physical: wp.int32, wants_incident: wp.int32, wants_environment: wp.int32,
        has_light: wp.int32, grad_normal: flat, grad_albedo: flat, grad_roughness: flat, grad_sh: flat,
        grad_visibility: flat, grad_indirect: flat, grad_environment: flat,
    ):  # fmt: skip
        pull_apart(
            begin + wp.tid(), given, index, camera, drawn, centre, coefficients, sh, slopes, lights, pulls,
            wants_own, wants_physical, wants_incident, wants_environment, has_light,
            grad_normal, grad_albedo, grad_roughness, grad_sh, grad_visibility, grad_indirect, grad_environment,
        )  # fmt: skip

    return SimpleNamespace(Inputs=Inputs, forward=forward, backward=backward)


_DIRECTIONS = native_file(__package__, "directions.inl")


@cache
def spread_kernel(dtype: torch.dtype) -> Any:
    """``spread`` for a scalar type: turns a set of directions to the hemisphere of each surfel; all arrays are flat.

    ``turn``: azimuth of each surfel's set, in turns. ``shift``: where sample i of each surfel lies in its band of
    heights, read if ``shifted``. ``around_z``: directions around +Z. ``direction``: the result.
    """
    start_warp()
    flat = wp.array(dtype=scalar_type(dtype))

    @wp.func_native(native_text(_DIRECTIONS["spread"], dtype, False, {}))
    def spread_set(
        surfel: wp.int32, samples: wp.int32, shifted: wp.int32, normal: flat, turn: flat, shift: flat,
        around_z: flat, direction: flat,
    ): ...  # fmt: skip

    @wp.kernel(enable_backward=False, module="unique", module_options=NATIVE)
    def spread(
        begin: wp.int32, samples: wp.int32, shifted: wp.int32, normal: flat, turn: flat, shift: flat,
        around_z: flat, direction: flat,
    ):  # fmt: skip
        spread_set(begin + wp.tid(), samples, shifted, normal, turn, shift, around_z, direction)

    return spread


def _written_for(section: str, dtype: torch.dtype, on_cuda: bool, kind: Kind) -> str:
    words = {
        "SAMPLES_IN_A_BLOCK": str(1 if on_cuda else LANES_ON_CPU),
        "ATAN_TERMS": str(ATAN_TERMS[dtype]),
        "EXP_TERMS": str(EXP_TERMS[dtype]),
        "F0": repr(FRESNEL_NORMAL),
        "TEXEL": str(TEXEL),
        **_WORDS[kind],
    }
    return native_text(_TEXT[section], dtype, on_cuda, words)
