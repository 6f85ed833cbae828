"""The kernels of rasterization, tracing, shading and image losses; one Warp source for CPU and CUDA."""
