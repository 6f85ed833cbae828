"""Freed memory is kept for the next buffer."""

import os
import platform
import subprocess
import sys

import pytest

from radiogs_core.kernels.runtime import keep_freed_memory

PROGRAM = """
import ctypes, resource
from radiogs_core.kernels.runtime import keep_freed_memory

library = ctypes.CDLL(None)
library.malloc.restype, library.free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
kept, touched = keep_freed_memory({}), []
for _ in range(5):
    before, buffer = resource.getrusage(resource.RUSAGE_SELF).ru_minflt, library.malloc(ctypes.c_size_t(2**26))
    ctypes.memset(buffer, 1, 2**26)
    library.free(buffer)
    touched.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
print(int(kept), sum(touched[1:]))
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="tests glibc's allocator")
def test_a_large_buffer_takes_the_pages_of_the_one_before() -> None:
    """64 MiB are 16,384 pages of 4 KiB, all of which the first buffer touches.

    The process is a new one: glibc changes the arena of a thread once an allocation of it has failed, as in tests of
    exhausted memory, and only its first arena holds buffers of this size.
    """
    own = {name: value for name, value in os.environ.items() if not name.startswith(("MALLOC_", "GLIBC_TUNABLES"))}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=own, capture_output=True, text=True, check=True)
    kept, touched = map(int, done.stdout.split())
    if not kept:
        pytest.skip("this version of glibc has a lower limit for what it keeps")
    assert touched < 2**14


@pytest.mark.parametrize(
    "environment", [{"MALLOC_TRIM_THRESHOLD_": "1000"}, {"GLIBC_TUNABLES": "glibc.malloc.mmap_threshold=1000"}]
)
def test_settings_of_the_user_stay(environment: dict[str, str]) -> None:
    assert not keep_freed_memory(environment)
