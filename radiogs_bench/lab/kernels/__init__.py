"""Measures kernels beside yardsticks in the same process, and relit frames (``bench kernels``, ``bench frames``)."""
