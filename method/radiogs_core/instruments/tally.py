"""Counts by name, some of which may still lie on a device."""

from collections import Counter
from collections.abc import Mapping

import torch
from torch import Tensor

Amount = int | Tensor
"""A count: a number, or a tensor of one integer, which is read from its device no sooner than it is asked for."""


class Tally:
    """Adds amounts up by name without waiting for a device."""

    def __init__(self, counts: Mapping[str, int] | None = None) -> None:
        self.known = Counter(counts or {})
        """What the host knows already."""
        self._unread: dict[str, Tensor] = {}

    def add(self, amounts: Mapping[str, Amount]) -> None:
        """Add to the counts of these names."""
        for name, amount in amounts.items():
            if not isinstance(amount, Tensor) or amount.device.type == "cpu":
                self.known[name] += int(amount)
            elif name in self._unread:
                self._unread[name] = self._unread[name] + amount.detach()
            else:
                self._unread[name] = amount.detach().long()

    def read(self) -> Counter[str]:
        """All counts; waits once for what lies on the device."""
        if self._unread:
            self.known.update(dict(zip(self._unread, torch.stack(list(self._unread.values())).tolist(), strict=True)))
            self._unread.clear()
        return self.known
