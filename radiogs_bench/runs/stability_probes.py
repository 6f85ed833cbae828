"""Curves of float32 error along a condition: types, measurement of a point, and the kernels as probes."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor

from radiogs_core.instruments import count, recording
from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP, SplatGeometry
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels

EPS = float(torch.finfo(torch.float32).eps)
"""Unit of all errors: the spacing of float32 at one, 1.19e-7."""

SAFE = 1e-3
"""A condition is in the safe range if its documented tolerance is at most this: 0.1 %, a quarter of an 8-bit
level."""

GRADIENT_TOLERANCE = 1e-3
"""Tolerance of gradients relative to the largest entry: cases 7 and 42 of the catalogue."""

Task = Literal["forward", "gradient"]
TASKS: tuple[Task, ...] = get_args(Task)

Values = Mapping[str, Tensor]
Tolerance = Callable[[float], float]


@dataclass(frozen=True)
class Stand:
    """The camera and sky of a case; ``seed`` is for its random numbers."""

    camera: Camera
    sky: EnvironmentMap
    seed: int

    def generator(self) -> torch.Generator:
        """A generator that draws the same numbers for every condition: only the condition changes along a curve."""
        return torch.Generator().manual_seed(self.seed)


@dataclass(frozen=True)
class Probe:
    """A computation under one condition.

    ``inputs`` are float32; ``run`` computes, in either precision, outputs that are compared one by one. ``units`` are
    the natural magnitudes of the outputs, such as 1 for coverage, below which errors are not relative: a nearly empty
    pixel need not be exact to a share of its value. ``fixed`` names inputs without gradient.
    """

    inputs: Values
    run: Callable[[Values], tuple[Tensor, ...]]
    units: tuple[float, ...]
    fixed: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Kernel:
    """A computation along an axis, with its documented tolerance for each condition."""

    probe: Callable[[float, Stand], Probe]
    forward: Tolerance
    gradient: Tolerance = lambda condition: GRADIENT_TOLERANCE

    def tolerance(self, task: Task, condition: float) -> float:
        """The documented tolerance of outputs or of gradients."""
        return (self.forward if task == "forward" else self.gradient)(condition)


@dataclass(frozen=True)
class Axis:
    """A condition that gets harder from ``easy`` to ``hard``; ``hard`` has two ends if it does so in both directions.

    ``label`` names the condition with its unit; ``whole`` conditions are integers.
    """

    key: str
    label: str
    easy: float
    hard: tuple[float, ...]
    kernels: Mapping[str, Kernel]
    whole: bool = False

    def conditions(self, points: int) -> list[float]:
        """``count`` conditions between the ends, evenly spaced in their logarithm."""
        first, last = self.hard if len(self.hard) == 2 else (self.easy, self.hard[0])
        ends = torch.tensor([first, last], dtype=torch.float64).log10()
        spaced = torch.logspace(float(ends[0]), float(ends[1]), points, dtype=torch.float64).tolist()
        spaced[0], spaced[-1] = first, last
        return list(dict.fromkeys(float(round(value)) if self.whole else value for value in spaced))


@dataclass(frozen=True)
class Errors:
    """Errors of one kernel under one condition.

    forward: the worst error of an output, relative to its unit or its largest entry, whichever is larger. gradient: the
    worst error of an input's gradient, relative to its largest entry. guards: counts in float32.
    """

    forward: float
    gradient: float
    guards: Counter[str]

    def of(self, task: Task) -> float:
        """The error of outputs, or of gradients."""
        return self.forward if task == "forward" else self.gradient


def measure(probe: Probe, seed: int, device: torch.device) -> Errors:
    """Run in float32, and in float64 on the same inputs; gradients are of a randomly weighted sum of the outputs."""
    inputs = {name: value.to(device) for name, value in probe.inputs.items()}
    with recording() as instruments:
        outputs, gradients = _both(probe, inputs, seed)
    count(**instruments.work)
    exact, exact_gradients = _both(probe, {name: value.double() for name, value in inputs.items()}, seed)
    return Errors(
        max(relative_error(*each) for each in zip(outputs, exact, probe.units, strict=True)),
        max(relative_error(*each, 0.0) for each in zip(gradients, exact_gradients, strict=True)),
        instruments.guards,
    )


def _both(probe: Probe, inputs: Values, seed: int) -> tuple[tuple[Tensor, ...], tuple[Tensor, ...]]:
    """Outputs, and the gradient of each input that has one."""
    leaves = {name: value.clone().requires_grad_(name not in probe.fixed) for name, value in inputs.items()}
    outputs = probe.run(leaves)
    generator = torch.Generator().manual_seed(seed)
    pulls = [torch.randn(output.shape, generator=generator).to(output) for output in outputs]
    wanted = [leaf for leaf in leaves.values() if leaf.requires_grad]
    gradients = torch.autograd.grad(outputs, wanted, pulls, allow_unused=True, materialize_grads=True)
    return tuple(output.detach() for output in outputs), gradients


def relative_error(found: Tensor, exact: Tensor, unit: float) -> float:
    """Largest difference over the largest exact entry, or over ``unit`` where that is larger.

    Infinite for NaN, and for a difference from exact zeros without a unit.
    """
    if not bool(torch.isfinite(found).all()):
        return float("inf")
    difference, largest = (float(value.abs().max()) for value in (found.double() - exact, exact))
    size = max(largest, unit)
    return 0.0 if difference == 0 else difference / size if size > 0 else float("inf")


GEOMETRY = ("centre", "axis_u", "axis_v", "normal", "opacity")
RAY_INPUTS = frozenset({"direction", "t_min"})
CHANNELS = 4
DEPTH = 4.0
"""Distance of most cases from the camera, in the scene's unit of length."""


def geometry_of(inputs: Values) -> SplatGeometry:
    """The surfels among a probe's inputs."""
    return SplatGeometry(*(inputs[name] for name in GEOMETRY))


def drawn(camera: Camera, inputs: Values) -> Probe:
    """K1 on ``GEOMETRY`` and features: images, alpha, depth, distortion."""

    def run(given: Values) -> tuple[Tensor, ...]:
        return _images(camera, geometry_of(given), given["features"], 1.0)

    return Probe({name: inputs[name] for name in (*GEOMETRY, "features")}, run, units_of_images(1.0))


def units_of_images(length: float) -> tuple[float, ...]:
    """Units of features, coverage, depth (``length``) and distortion (square of the depth over ``length``)."""
    return (1.0, 1.0, length, DEPTH**2)


def drawn_surfels(camera: Camera, surfels: Surfels, features: Tensor, depth_unit: float = 1.0) -> Probe:
    """K1 on raw surfels, widened by the footprint of a pixel as in training; ``depth_unit`` is the scene's length."""
    raw = ("centre", "rotation", "log_scale", "opacity_logit")
    parameters = surfels.parameters()

    def run(given: Values) -> tuple[Tensor, ...]:
        known = {name: value.to(given["centre"]) for name, value in parameters.items()}
        shown = Surfels.of(known | {name: given[name] for name in raw})
        seen_by = camera.to(given["centre"].device, given["centre"].dtype)
        return _images(seen_by, shown.geometry_for(seen_by), given["features"], depth_unit)

    inputs = {name: parameters[name] for name in raw} | {"features": features}
    return Probe(inputs, run, units_of_images(depth_unit))


def _images(camera: Camera, geometry: SplatGeometry, features: Tensor, depth_unit: float) -> tuple[Tensor, ...]:
    raster = rasterize(camera, geometry, features, depth_unit)
    return raster.features, raster.alpha, raster.depth, raster.distortion


def traced(inputs: Values, length: float = 1.0, stop: float = TRACE_TRANSMITTANCE_STOP) -> Probe:
    """K2 on surfels and rays (``length`` is the scene's unit): radiance, transmittance, features, depth."""

    def run(given: Values) -> tuple[Tensor, ...]:
        geometry = geometry_of(given)
        hits = trace(
            SurfelBVH.build(geometry.detach()), geometry, given["sh"], given["features"],
            given["origin"], given["direction"], given["t_min"], stop,
        )  # fmt: skip
        return hits.radiance, hits.transmittance, hits.features, hits.depth

    names = (*GEOMETRY, "sh", "features", "origin", "direction", "t_min")
    return Probe({name: inputs[name] for name in names}, run, (1.0, 1.0, 1.0, length), RAY_INPUTS)


def shaded(inputs: Values, weight: Callable[[Values], Tensor] | None = None) -> Probe:
    """K3: the four parts of the reflected light. ``weight`` makes solid angles that are not inputs."""

    def run(given: Values) -> tuple[Tensor, ...]:
        angles = given["weight"] if weight is None else weight(given)
        parts = shade(
            given["normal"], given["albedo"], given["roughness"], given["outgoing"], given["direction"],
            angles.detach(), given["visibility"], given["indirect"], given["environment"],
        )  # fmt: skip
        return tuple(parts.unbind(2))

    return Probe(inputs, run, (1.0, 1.0, 1.0, 1.0), frozenset({"outgoing", "direction", "weight"}))


def looks(count: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Random features, and harmonics whose radiance stays well above zero, where it is clamped."""
    return {
        "features": torch.rand(count, CHANNELS, generator=generator),
        "sh": 0.1 * torch.rand(count, COEFFICIENTS, 3, generator=generator),
    }


def rays(origin: Tensor, direction: Tensor) -> dict[str, Tensor]:
    """Origins and directions of rays, as the tracer takes them."""
    return {"origin": origin, "direction": direction, "t_min": torch.zeros(len(origin))}
