"""What the harness asks of a method: two stages that step, save and restore."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import torch

from radiogs.budget import Budget
from radiogs.model import Model
from radiogs.variant import Variant
from radiogs_core.scene.scene import Scene


@runtime_checkable
class Stage(Protocol):
    """A resumable optimisation: restoring a state and stepping on gives what stepping on would have given."""

    iteration: int
    iterations: int

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name. Raises NumericalFailure."""

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which to continue bit for bit."""

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state."""


@runtime_checkable
class ModelStage(Stage, Protocol):
    """A stage that learns the model."""

    @property
    def model(self) -> Model:
        """What is learnt so far."""


@dataclass(frozen=True)
class Method:
    """How to begin each stage; the second begins from the state in which the first ended."""

    initialise: Callable[[Scene, Variant, Budget, int, torch.device], Stage]
    invert: Callable[[Scene, Variant, Budget, int, torch.device, dict[str, Any]], ModelStage]
