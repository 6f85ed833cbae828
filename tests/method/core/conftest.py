"""Both arrangements of a kernel's work on the CPU, and a card."""

from collections.abc import Iterator
from contextlib import nullcontext

import pytest
import torch

from cards import ON_CARD
from radiogs_core.kernels.arrangement import cpu_as_cuda

ON_CPU = ["as_on_cpu", "as_on_cuda"]


@pytest.fixture(params=ON_CPU)
def cpu_arrangement(request: pytest.FixtureRequest) -> Iterator[str]:
    """Arrangements for a test that holds for both on the CPU; sums by atomics on a card do not repeat bit for bit."""
    with cpu_as_cuda() if request.param == "as_on_cuda" else nullcontext():
        yield request.param


@pytest.fixture(params=[*ON_CPU, pytest.param("on_card", marks=ON_CARD)])
def arrangement(request: pytest.FixtureRequest) -> Iterator[str]:
    """Arrangements for a test that holds for blocks of items on the CPU, and for an item a thread on the CPU and on
    CUDA."""
    if request.param == "as_on_cpu":
        yield request.param
    elif request.param == "as_on_cuda":
        with cpu_as_cuda():
            yield request.param
    else:
        with torch.device("cuda"):
            yield request.param
