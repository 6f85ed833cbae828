"""The loop of a stage on surfels: views in turn, losses, the backward pass, a step of Adam, and resuming."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Generic

import torch
from torch import Tensor

from ..contract import BudgetT, Run, VariantT
from ..learning.backward import backward
from ..learning.views import TrainingView, chosen_views, load, mean_distance, view_at
from ..surfels.optimiser import SurfelOptimiser


class SurfelStage(ABC, Generic[VariantT, BudgetT]):
    """Learns surfels, and further tensors, from the training views of a scene; a ``contract.Stage``.

    A subclass makes ``optimiser`` in its ``__init__``, from what its parameters start as, and gives the ``losses`` of a
    step and the ``product``. It may change what is drawn or scheduled before a step (``begin_step``).
    """

    name = "invert"
    optimiser: SurfelOptimiser
    """All that is learnt, with its learning rates."""

    def __init__(self, run: Run[VariantT, BudgetT], iterations: int, view_share: float) -> None:
        self.variant, self.budget, self.seed, self.device = run.variant, run.budget, run.seed, run.device
        self.iteration, self.iterations = 0, iterations
        self.views = load(chosen_views(run.scene, view_share, run.seed), run.device)
        self.depth_unit = mean_distance(self.views, run.scene.centre)
        self.generator = torch.Generator(run.device).manual_seed(run.seed)

    def step(self) -> Mapping[str, float]:
        """One optimisation step; returns the weighted losses by name. Raises NumericalFailure."""
        self.begin_step()
        view = view_at(self.views, self.iteration, self.seed)
        losses = self.losses(view)
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.move(view)
        self.iteration += 1
        return values

    def begin_step(self) -> None:
        """Set what this step's place in the schedule decides, before its losses; nothing by default."""

    @abstractmethod
    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step by name, if it looks at ``view``."""

    def move(self, view: TrainingView) -> None:
        """Step the optimiser by the gradients of the losses that ``view`` gave."""
        self.optimiser.step()

    @abstractmethod
    def product(self) -> dict[str, Any]:
        """The input of the next stage, or of ``Method.restore``, as plain tensors."""

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        return {
            "iteration": self.iteration,
            "optimiser": self.optimiser.state(),
            "generator": self.generator.get_state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.iteration = state["iteration"]
        self.optimiser.restore(state["optimiser"])
        self.generator.set_state(state["generator"])
