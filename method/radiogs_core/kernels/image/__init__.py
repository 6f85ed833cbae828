"""Kernels over the pixels of images: the terms of losses, depth maps and display colour."""
