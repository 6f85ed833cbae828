"""Kernels over the pixels of images: what losses compare."""
