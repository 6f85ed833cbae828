"""A kernel is compiled once, by one thread of one process."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import pytest
import torch
import warp as wp
from filelock import FileLock

from radiogs_core.kernels.recorded import compile_for
from radiogs_core.kernels.runtime import launch, start_warp

CPU = torch.device("cpu")

start_warp()


def new_kernel(number: float) -> wp.Kernel:
    """A kernel that is loaded nowhere yet."""

    @wp.kernel(enable_backward=False, module="unique")
    def filled(first: wp.int32, out: wp.array(dtype=wp.float32)):
        out[first + wp.tid()] = wp.static(number)

    return filled


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    return tmp_path


def test_threads_and_launches_compile_a_kernel_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For single threads, and not additionally for blocks of threads."""
    kernel, loaded, begun = new_kernel(1.0), [], Event()
    load = wp.force_load

    def slow(*args: Any) -> None:
        loaded.append(args)
        begun.wait(0.2)
        load(*args)

    monkeypatch.setattr(wp, "force_load", slow)
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(lambda _: compile_for(CPU, kernel), range(3)))
    out = torch.zeros(3)
    launch(kernel, 3, CPU, [out])
    assert out.tolist() == [1, 1, 1]
    assert len(loaded) == 1
    assert sum(path.is_dir() for path in cache.iterdir()) == 1


@pytest.fixture
def loaded(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the modules that would have been compiled."""
    names: list[str] = []
    monkeypatch.setattr(wp, "force_load", lambda _, modules: names.extend(module.name for module in modules))
    return names


def test_a_kernel_that_another_process_compiles_is_waited_for(cache: Path, loaded: list[str]) -> None:
    kernel = new_kernel(2.0)
    with ThreadPoolExecutor(1) as pool:
        with FileLock(cache / f"{kernel.module.name}.lock"):
            compiled = pool.submit(compile_for, CPU, kernel)
            with pytest.raises(TimeoutError):
                compiled.result(0.2)
            assert not loaded
        compiled.result()
    assert loaded == [kernel.module.name]


def test_a_cache_that_may_only_be_read_is_no_failure(
    cache: Path, loaded: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(lock: FileLock) -> None:
        raise PermissionError

    monkeypatch.setattr(FileLock, "acquire", refused)
    compile_for(CPU, new_kernel(3.0))
    assert len(loaded) == 1
