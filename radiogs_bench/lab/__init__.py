"""Measures how long and how much: kernels, steps, rehearsals of long runs."""
