"""Adam over surfels whose number changes: moments follow their surfel, and new surfels start without moments."""

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor

from ..kernels.adam import MOMENTS, Adam
from .surfels import Surfels

ADAM_EPSILON = 1e-15
"""3DGS's value: gradients of single surfels are small, and a larger one would freeze them."""


class SurfelOptimiser:
    """Optimises the raw parameters of surfels, and further named tensors, each at its own learning rate.

    Args:
        surfels: Surfels at the start.
        further: Further tensors at the start, by name.
        rates: Learning rates by the name of the parameter or tensor; ``"sh_rest"`` is the rate of the harmonics above
            degree 0. A parameter with rate zero does not change; a further tensor has no gradient then.
    """

    def __init__(self, surfels: Surfels, further: Mapping[str, Tensor], rates: Mapping[str, float]) -> None:
        self.rates = dict(rates)
        self.tensors: dict[str, Tensor] = {}
        self._adopt(surfels)
        self.tensors |= {name: value.detach().clone().requires_grad_() for name, value in further.items()}
        self.further = tuple(further)
        self.adam = Adam(ADAM_EPSILON)
        for name in self.further:
            self.tensors[name].requires_grad_(self.rates[name] > 0)

    def _adopt(self, surfels: Surfels) -> None:
        # Degree 0 and the higher degrees have different rates, so they are separate tensors.
        for name, value in surfels.parameters().items():
            parts = {"sh": value[:, :1], "sh_rest": value[:, 1:]} if name == "sh" else {name: value}
            self.tensors |= {part: piece.detach().clone().requires_grad_() for part, piece in parts.items()}

    @property
    def surfels(self) -> Surfels:
        """The current surfels, with gradient to the tensors that are optimised."""
        own = {name: value for name, value in self.tensors.items() if name not in self.further}
        own["sh"] = torch.cat([own["sh"], own.pop("sh_rest")], 1)
        return Surfels.of(own)

    def set_rate(self, name: str, rate: float) -> None:
        """Change one learning rate."""
        self.rates[name] = rate
        if name in self.further:
            self.tensors[name].requires_grad_(rate > 0)

    def step(self) -> None:
        """One Adam step; gradients are cleared."""
        self.adam.step(self.tensors, self.rates)

    def replace(self, surfels: Surfels, origin: Int[Tensor, " surfels"]) -> None:
        """Replace the surfels; ``origin``: index of the old surfel whose moments each inherits (-1: none)."""
        self._adopt(surfels)
        kept, inherited = origin >= 0, origin.clamp(min=0)
        for name, moments in self.adam.moments.items():
            if name in self.further:
                continue
            for key in MOMENTS:
                moment = moments[key][inherited]
                moments[key] = torch.where(kept.view(-1, *(1,) * (moment.dim() - 1)), moment, 0.0)

    def forget(self, name: str) -> None:
        """Clear the moments of one parameter, after its value was set from outside."""
        self.adam.moments.pop(name, None)

    def state(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit."""
        tensors = {name: value.detach() for name, value in self.tensors.items()}
        return {"tensors": tensors, "moments": self.adam.state(), "rates": dict(self.rates)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """The inverse of ``state``."""
        for name in self.tensors:
            self.tensors[name] = state["tensors"][name].clone().requires_grad_()
        for name, rate in state["rates"].items():
            self.set_rate(name, rate)
        self.adam.restore(state["moments"])
