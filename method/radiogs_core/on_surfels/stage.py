"""The training loop of a stage on surfels: views in turn, losses, backward pass, Adam step, and resuming."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, Generic

import torch
from torch import Tensor

from ..contract import BudgetT, Run, VariantT
from ..learning.backward import backward
from ..learning.views import TrainingView, chosen_views, load, mean_distance, view_at
from ..surfels.optimiser import SurfelOptimiser
from .model import SurfelModel


class SurfelStage(ABC, Generic[VariantT, BudgetT]):
    """Learns surfels, and further tensors, from the training views of a scene; a ``contract.Stage``.

    A subclass makes ``optimiser`` in its ``__init__``, from the initial values of its parameters, and implements
    ``losses``, and ``model`` or ``product``. It may override ``begin_step``, which runs before the losses of each step.
    """

    name = "invert"
    optimiser: SurfelOptimiser
    """The surfels and tensors that are learnt, with their learning rates."""

    def __init__(self, run: Run[VariantT, BudgetT], iterations: int, view_share: float) -> None:
        self.variant, self.budget, self.seed, self.device = run.variant, run.budget, run.seed, run.device
        self.iteration, self.iterations = 0, iterations
        self.views = load(chosen_views(run.scene, view_share, run.seed), run.device)
        self.depth_unit = mean_distance(self.views, run.scene.centre)
        self.generator = torch.Generator(run.device).manual_seed(run.seed)

    def step(self) -> Mapping[str, float]:
        """Take one optimisation step; returns the weighted losses by name.

        Raises NumericalFailure for a loss or gradient that is not finite.
        """
        self.begin_step()
        view = view_at(self.views, self.iteration, self.seed)
        losses = self.losses(view)
        values = backward(self.name, self.iteration, losses, self.optimiser.tensors)
        self.move(view)
        self.iteration += 1
        return values

    def begin_step(self) -> None:
        """Apply the schedule of this step, such as learning rates; does nothing by default."""

    @abstractmethod
    def losses(self, view: TrainingView) -> dict[str, Tensor]:
        """The weighted losses of the next step, on ``view``, by name."""

    def move(self, view: TrainingView) -> None:
        """Step the optimiser with the gradients of the losses of ``view``."""
        self.optimiser.step()

    @property
    def model(self) -> SurfelModel:
        """The model at the current iteration."""
        raise NotImplementedError

    def product(self) -> dict[str, Any]:
        """The input of the next stage, or of ``Method.restore``: the model's plain tensors."""
        return self.model.tensors()

    def state(self) -> dict[str, Any]:
        """Tensors and plain values from which ``restore`` continues bit for bit."""
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
