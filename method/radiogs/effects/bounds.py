"""One-sided bounds on means and probabilities, from a sample."""

import math
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

RESAMPLES_PER_TAIL = 5
"""Expected number of resamples beyond the quantile: its probability is known to within a factor of about 1.5."""

MOST_BATCHES = 256
"""Largest number of values that are resampled; more values are averaged in batches, which are closer to normal."""


def sidak(level: float, comparisons: int) -> float:
    """Error probability of each of several independent statements that hold together with error ``level``.

    >>> round(sidak(0.01, 10), 6)
    0.001005
    """
    return -math.expm1(math.log1p(-level) / comparisons)


def bootstrap_t(
    values: Float[Tensor, "statistics sample"], level: float, generator: torch.Generator
) -> tuple[Float[Tensor, " statistics"], Float[Tensor, " statistics"]]:
    """Lower and upper bounds on each statistic's mean by the bootstrap-t, float64, each with an error of ``level``.

    The bound is mean - q s / sqrt(n), with q the quantile of the resampled (mean* - mean) / (s* / sqrt(n)). Skewed
    samples, such as squared errors, get a longer tail than by Student's t. All statistics share their resamples.

    More than MOST_BATCHES values are first averaged in that many batches; ``generator`` shuffles values into batches.
    Bounds are infinite for fewer than two values, and if so many resamples are constant that the quantile is not known.
    """
    values = _batched(values.detach().double().cpu(), generator)
    mean, count = values.mean(1), values.shape[1]
    if count < 2:
        return torch.full_like(mean, -torch.inf), torch.full_like(mean, torch.inf)
    resamples = math.ceil(RESAMPLES_PER_TAIL / level)
    times = resample_counts(count, resamples).double()
    centred = values - mean[:, None]
    moved = centred @ times.T / count
    spread = ((centred.square() @ times.T / count - moved.square()).clamp(min=0) / (count - 1)).sqrt()
    # The standard error of a constant resample is zero: its ratio may be any number, of either sign.
    constant = spread <= 1e-12 * centred.abs().amax(1, keepdim=True)
    ratio = torch.where(constant, 0.0, moved / torch.where(constant, 1.0, spread))
    rank = max(1, math.floor(level * resamples))
    lowest = torch.where(constant, -torch.inf, ratio).kthvalue(rank, 1).values
    highest = torch.where(constant, torch.inf, ratio).kthvalue(resamples + 1 - rank, 1).values
    error = values.std(1) / math.sqrt(count)
    known = error > 0
    return torch.where(known, mean - highest * error, mean), torch.where(known, mean - lowest * error, mean)


@lru_cache(maxsize=8)
def resample_counts(count: int, resamples: int) -> Float[Tensor, "resamples sample"]:
    """Number of times that each of ``count`` values is drawn in each resample; the seed is ``count``."""
    drawn = torch.randint(count, (resamples, count), generator=torch.Generator().manual_seed(count))
    return torch.zeros(drawn.shape).scatter_add_(1, drawn, torch.ones(1).expand_as(drawn))


def _batched(values: Float[Tensor, "statistics sample"], generator: torch.Generator) -> Tensor:
    count = values.shape[1]
    if count <= MOST_BATCHES:
        return values
    kept = count - count % MOST_BATCHES
    shuffled = values[:, torch.randperm(count, generator=generator)[:kept]]
    return shuffled.unflatten(1, (MOST_BATCHES, -1)).mean(2)
