"""Both arrangements of a kernel's work, on the CPU."""

from collections.abc import Iterator

import pytest

from radiogs_core.kernels.arrangement import cpu_as_cuda


@pytest.fixture(params=["as_on_cpu", "as_on_cuda"])
def arrangement(request: pytest.FixtureRequest) -> Iterator[str]:
    """What a test uses that holds for blocks of items on the CPU and for an item a thread on CUDA."""
    if request.param == "as_on_cpu":
        yield request.param
        return
    with cpu_as_cuda():
        yield request.param
