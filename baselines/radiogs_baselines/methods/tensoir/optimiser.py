"""Adam on named parameters whose shapes may change, with a state that resumes bit for bit."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from .field import GRIDS
from .variant import Rates

MOMENTS = (0.9, 0.99)
"""Decay of Adam's moments."""


class Optimiser:
    """Grids step at one rate, networks and light at another; both fall from where the grid was last made finer.

    ``total``: steps over which they fall to ``rates.end``.
    """

    def __init__(self, parameters: Mapping[str, Tensor], rates: Rates, network_rate: float, total: int) -> None:
        self.rates, self.network_rate, self.total = rates, network_rate, total
        self.since = 0
        self.replace(parameters)

    def replace(self, parameters: Mapping[str, Tensor]) -> None:
        """Begin anew with other parameters: without moments, and at the first rates."""
        self.since = 0
        self.tensors = {name: value.detach().clone().requires_grad_() for name, value in parameters.items()}
        groups = [{"params": [value], "name": name} for name, value in self.tensors.items()]
        self.adam = torch.optim.Adam(groups, betas=MOMENTS)

    def step(self) -> None:
        """One step; gradients are gone afterwards."""
        left = self.rates.end ** (self.since / self.total)
        for group in self.adam.param_groups:
            on_grid = group["name"] in GRIDS
            group["lr"] = left * (self.rates.grid if on_grid else self.rates.network * self.network_rate)
        self.adam.step()
        self.adam.zero_grad()
        self.since += 1

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        moments = {
            name: dict(self.adam.state[value]) for name, value in self.tensors.items() if value in self.adam.state
        }
        return {"tensors": self.plain(), "moments": moments, "since": self.since}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        self.replace(state["tensors"])
        self.since = state["since"]
        for name, moments in state["moments"].items():
            self.adam.state[self.tensors[name]] = {key: value.clone() for key, value in moments.items()}

    def plain(self) -> dict[str, Tensor]:
        """The parameters without gradient history."""
        return {name: value.detach() for name, value in self.tensors.items()}
