"""Measures the kernels on this machine beside yardsticks in the same process (``bench kernels``)."""

from .bench import Row, bench_kernels, scaling
from .record import as_json, as_table

__all__ = ["Row", "as_json", "as_table", "bench_kernels", "scaling"]
