"""Quantiles of any number of values, exactly: ``torch.quantile`` refuses more than 2^24 values, and sorts a copy."""

import math
from collections.abc import Callable, Iterable

import torch
from jaxtyping import Float, Int
from torch import Tensor

HALF = 1 << 16
"""Number of values of half a 32-bit key: a key is found by two counts, of its upper half and then of its lower."""

Parts = Callable[[], Iterable[Float[Tensor, " values"]]]
"""Yields all values, float32, part by part, at each call; only one part is in memory at a time."""


def quantile(parts: Parts, share: float) -> float | None:
    """The value below which a share in [0, 1] of all values lies, linear between two of them; None without values.

    The result is ``torch.quantile`` of all parts joined, except that the rank is computed in float64 here. Needs memory
    for one part and 65,536 counts, for any number of values below 2^53. Values have to be finite.
    """
    count = sum(part.numel() for part in parts())
    if not count:
        return None
    rank = share * (count - 1)
    below = math.floor(rank)
    lower, upper = _order_statistic(parts, below), _order_statistic(parts, min(below + 1, count - 1))
    return lower + (upper - lower) * (rank - below)


def _order_statistic(parts: Parts, rank: int) -> float:
    """The value of a rank, from 0, among all values in ascending order."""
    upper, before = _bin_of(_counts(parts, lambda key: (key >> 16) + HALF // 2), rank)
    inside = upper - HALF // 2
    lower, _ = _bin_of(_counts(parts, lambda key: key[key >> 16 == inside] & (HALF - 1)), rank - before)
    return float(_ordered(torch.tensor(inside * HALF + lower, dtype=torch.int32)).view(torch.float32))


def _counts(parts: Parts, half: Callable[[Int[Tensor, " values"]], Int[Tensor, " chosen"]]) -> Int[Tensor, " bins"]:
    """How often each half of a key occurs."""
    counts = torch.zeros(HALF, dtype=torch.int64)
    for part in parts():
        keys = _ordered(part.detach().flatten().contiguous().view(torch.int32))
        counts += torch.bincount(half(keys), minlength=HALF).cpu()
    return counts


def _bin_of(counts: Int[Tensor, " bins"], rank: int) -> tuple[int, int]:
    """The bin that holds the value of a rank, and how many values lie in the bins before it."""
    ends = counts.cumsum(0)
    found = int(torch.searchsorted(ends, rank, right=True))
    return found, int(ends[found - 1]) if found else 0


def _ordered(bits: Int[Tensor, " *any"]) -> Int[Tensor, " *any"]:
    """Converts bits of float32 to integers in the order of the values, and back: negative values count downwards."""
    return bits ^ ((bits >> 31) & 0x7FFFFFFF)
