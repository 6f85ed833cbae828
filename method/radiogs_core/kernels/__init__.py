"""The three kernels that cost all the time: rasterize, trace, shade; one Warp source for CPU and CUDA."""
