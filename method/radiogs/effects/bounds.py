"""One-sided bounds on means and shares that are known from a sample."""

import math
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

RESAMPLES_PER_TAIL = 5
"""Resamples that fall beyond the quantile asked for: its probability is known to within a factor of about 1.5."""

MOST_BATCHES = 256
"""Observations that are resampled at most; their means are nearer to normal than they are."""


def sidak(level: float, comparisons: int) -> float:
    """The level of each of several statements that hold together with ``level`` (of error, such as 0.01).

    >>> round(sidak(0.01, 10), 6)
    0.001005
    """
    return -math.expm1(math.log1p(-level) / comparisons)


def zero_events_upper(trials: int, level: float) -> float:
    """Upper bound on the probability of an event that none of ``trials`` independent trials has seen.

    1 - level^(1/n): with 2048 trials and a level of 0.01 it is 0.22 %.
    """
    return -math.expm1(math.log(level) / trials) if trials else 1.0


class Bootstrap:
    """One-sided bounds on means by the bootstrap-t, each with an error of ``level``.

    mean - q s / sqrt(n), q the quantile of the resampled (mean* - mean) / (s* / sqrt(n)): skewed samples, which squared
    errors are, get the longer tail that Student's t would deny them. Resamples are drawn once for each size of sample,
    and serve all; ``generator`` shuffles values into batches.
    """

    def __init__(self, level: float, generator: torch.Generator) -> None:
        self.level, self.generator = level, generator
        self.resamples = math.ceil(RESAMPLES_PER_TAIL / level)

    def bounds(
        self, values: Float[Tensor, "statistics sample"]
    ) -> tuple[Float[Tensor, " statistics"], Float[Tensor, " statistics"]]:
        """Lower and upper bounds of each statistic's mean, float64.

        More than MOST_BATCHES values are averaged in that many batches first. Infinite for fewer than two values, and
        where so many resamples are constant that the quantile is not known.
        """
        values = _batched(values.detach().double().cpu(), self.generator)
        mean, count = values.mean(1), values.shape[1]
        if count < 2:
            return torch.full_like(mean, -torch.inf), torch.full_like(mean, torch.inf)
        times = resample_counts(count, self.resamples).double()
        centred = values - mean[:, None]
        moved = centred @ times.T / count
        spread = ((centred.square() @ times.T / count - moved.square()).clamp(min=0) / (count - 1)).sqrt()
        # A resample that is constant says that the mean may be arbitrarily many of its errors away, on either side.
        constant = spread <= 1e-12 * centred.abs().amax(1, keepdim=True)
        ratio = torch.where(constant, 0.0, moved / torch.where(constant, 1.0, spread))
        place = max(1, math.floor(self.level * self.resamples))
        lowest = torch.where(constant, -torch.inf, ratio).kthvalue(place, 1).values
        highest = torch.where(constant, torch.inf, ratio).kthvalue(self.resamples + 1 - place, 1).values
        error = values.std(1) / math.sqrt(count)
        known = error > 0
        return torch.where(known, mean - highest * error, mean), torch.where(known, mean - lowest * error, mean)


@lru_cache(maxsize=8)
def resample_counts(count: int, resamples: int) -> Float[Tensor, "resamples sample"]:
    """How often each of ``count`` values is in each resample: the same for all samples of a size, as tables are."""
    drawn = torch.randint(count, (resamples, count), generator=torch.Generator().manual_seed(count))
    return torch.zeros(drawn.shape).scatter_add_(1, drawn, torch.ones(1).expand_as(drawn))


def bootstrap_t(
    values: Float[Tensor, "statistics sample"], level: float, generator: torch.Generator
) -> tuple[Float[Tensor, " statistics"], Float[Tensor, " statistics"]]:
    """Lower and upper bounds on the means of some statistics, each with an error of ``level``; see ``Bootstrap``."""
    return Bootstrap(level, generator).bounds(values)


def _batched(values: Float[Tensor, "statistics sample"], generator: torch.Generator) -> Tensor:
    count = values.shape[1]
    if count <= MOST_BATCHES:
        return values
    kept = count - count % MOST_BATCHES
    shuffled = values[:, torch.randperm(count, generator=generator)[:kept]]
    return shuffled.unflatten(1, (MOST_BATCHES, -1)).mean(2)
