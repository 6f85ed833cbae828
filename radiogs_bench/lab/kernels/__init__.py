"""Measures the kernels on this machine beside yardsticks in the same process (``bench kernels``)."""
