"""The plan of a rehearsal: rows and their short runs, the scene, and the bounds."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from radiogs_core.capabilities import Rehearsing, Relighting, ShortRun, StepKind
from radiogs_core.contract import Method
from radiogs_core.errors import UsageError
from radiogs_core.scene.scene import Scene

from ...method_calls import calling

STEPS = 4
"""Steps of each stage of a method that cannot shorten its runs."""

CLOCKS: Mapping[str, Callable[[], float]] = {"wall": time.perf_counter, "core": time.process_time}
"""Clocks by name: wall time, and time for which this process has a core."""


@dataclass(frozen=True)
class RehearsedRow:
    """A row to be rehearsed: its method, and the variant and budget of its whole run."""

    key: str
    method: Method
    found_as: str
    variant: Any
    budget: Any

    def sizes(self) -> tuple[int, int] | None:
        """Sizes of its models: at the start and at most; None if the method does not report sizes."""
        return self.method.sizes(self.budget) if isinstance(self.method, Rehearsing) else None

    def short(self, size: int | None) -> ShortRun:
        """A run of few steps with models of this size (None: initial size). Raises UsageError for program stages."""
        if isinstance(self.method, Rehearsing) and size is not None:
            return self.method.short_run(self.variant, self.budget, size)
        with calling(self.method.name, "stages()"):
            specs = self.method.stages(self.variant, self.budget)
        for spec in specs:
            if spec.keeps_files:
                raise UsageError(
                    f"{self.method.name} cannot be rehearsed",
                    f"Its stage '{spec.name}' is a program of its own, which takes all its steps.",
                    "Leave its rows out with --method.",
                )
        kinds = {spec.name: (StepKind("step", frozenset(range(min(STEPS, spec.steps))), spec.steps),) for spec in specs}
        return ShortRun(self.variant, self.budget, kinds, (Relighting("relighting", self.variant, 0),))


def size_range(rows: Sequence[RehearsedRow]) -> tuple[int, int] | None:
    """The smallest initial size of the rows' models, and the largest of all; None if no method reports sizes."""
    known = [sizes for row in rows if (sizes := row.sizes()) is not None]
    return (min(first for first, _ in known), max(last for _, last in known)) if known else None


@dataclass(frozen=True)
class Plan:
    """The input of a rehearsal."""

    name: str
    """Name of the suite or scene."""
    preset: str
    rows: Sequence[RehearsedRow]
    scene: Scene
    protocol: str
    cells: int
    """Scenes that the whole run has for each row."""
    device: torch.device
    memory: Mapping[str, int]
    """Bytes that may be taken, by kind: "host", "device"."""
    seconds: float
    """Seconds after which no larger size is begun."""
    sizes: Sequence[int] = ()
    """Sizes of the models, ascending; empty: ``climb.sizes_of`` chooses them."""
    clock: str = "wall"
    """The clock of ``CLOCKS`` that phases are timed by."""
    other_device: str | None = None
    """Name in ``limits.KNOWN_DEVICES`` of another device that the forecast is also made for."""
