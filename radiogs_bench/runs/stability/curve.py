"""Curves of float32 error along a condition: their parts, and how a point is measured."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor

from radiogs_core.instruments import count, recording
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap

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
    """The camera and sky that a case is placed in; ``seed`` is for its random numbers."""

    camera: Camera
    sky: EnvironmentMap
    seed: int

    def generator(self) -> torch.Generator:
        """Draws the same numbers for every condition, so that only the condition changes along a curve."""
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
    worst error of an input's gradient, relative to its largest entry. guards: those that acted in float32.
    """

    forward: float
    gradient: float
    guards: Counter[str]

    def of(self, task: Task) -> float:
        """The error of outputs or of gradients."""
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

    Infinite for NaN, and for a difference from zero where there is no unit.
    """
    if not bool(torch.isfinite(found).all()):
        return float("inf")
    difference, largest = (float(value.abs().max()) for value in (found.double() - exact, exact))
    size = max(largest, unit)
    return 0.0 if difference == 0 else difference / size if size > 0 else float("inf")
