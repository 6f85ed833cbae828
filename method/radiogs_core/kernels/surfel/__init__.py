"""Kernels over single surfels: their geometry, frames, and radiance from harmonics."""
