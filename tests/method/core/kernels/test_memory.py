"""Freed memory is kept for the next buffer."""

import ctypes
import platform
import resource

import pytest

from radiogs_core.kernels.runtime import keep_freed_memory, start_warp

start_warp()


def page_faults() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="of glibc's allocator")
def test_a_large_buffer_takes_the_pages_of_the_one_before() -> None:
    """64 MiB are 16,384 pages of 4 KiB; the first buffer makes room."""
    library = ctypes.CDLL(None)
    library.malloc.restype, library.free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    touched = []
    for _ in range(5):
        before, buffer = page_faults(), library.malloc(ctypes.c_size_t(2**26))
        ctypes.memset(buffer, 1, 2**26)
        library.free(buffer)
        touched.append(page_faults() - before)
    assert sum(touched[1:]) < 2**14


@pytest.mark.parametrize(
    "environment", [{"MALLOC_TRIM_THRESHOLD_": "1000"}, {"GLIBC_TUNABLES": "glibc.malloc.mmap_threshold=1000"}]
)
def test_settings_of_the_user_stay(environment: dict[str, str]) -> None:
    assert not keep_freed_memory(environment)
