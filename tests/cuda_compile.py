"""Every kernel, and compiling kernels for CUDA on a machine without a GPU or its driver: NVRTC comes with Warp."""

from pathlib import Path
from tempfile import TemporaryDirectory

import torch
import warp as wp

from radiogs_core.kernels.adam import step_kernel
from radiogs_core.kernels.image.depth_map import normal_kernels, point_kernels, surface_kernel
from radiogs_core.kernels.image.display import display_kernels
from radiogs_core.kernels.image.edges import allowance_kernel, edge_kernels
from radiogs_core.kernels.image.matching import sweep_kernel
from radiogs_core.kernels.image.similarity import similarity_kernels
from radiogs_core.kernels.image.terms import term_kernels
from radiogs_core.kernels.rasterize.binning import binning_kernels
from radiogs_core.kernels.rasterize.projection import geometry_kernels, seen_kernels
from radiogs_core.kernels.rasterize.rasterize import blend_kernels, gather_kernel
from radiogs_core.kernels.shade.consistency import consistency_kernels
from radiogs_core.kernels.shade.directions import spread_kernel
from radiogs_core.kernels.shade.lookup import lookup_kernels
from radiogs_core.kernels.shade.shade import arrival_kernel, shade_kernels
from radiogs_core.kernels.shade.splitsum import splitsum_kernels
from radiogs_core.kernels.surfel.footprint import axes_kernels, footprint_kernels, frame_kernels
from radiogs_core.kernels.surfel.harmonics import harmonics_kernels
from radiogs_core.kernels.surfel.support import support_kernel
from radiogs_core.kernels.trace.bvh import fit_kernels
from radiogs_core.kernels.trace.hits import hit_kernels
from radiogs_core.kernels.trace.ray_order import code_kernel
from radiogs_core.kernels.trace.sah import sah_kernel
from radiogs_core.kernels.trace.trace import trace_kernels

ARCHITECTURES = (80, 89, 90)
"""Compute capabilities 8.0 (A100), 8.9 (RTX 40) and 9.0 (H100)."""


def compiles_for_cuda(module: wp.Module, architectures: tuple[int, ...] = ARCHITECTURES) -> None:
    """Compile all kernels of a Warp module to machine code of each architecture; a compiler's refusal raises.

    Machine code (cubin) instead of PTX: registers, stack and shared memory are allotted, so their limits hold too.
    """
    for architecture in architectures:
        with TemporaryDirectory() as folder:
            wp.compile_aot_module(module, arch=architecture, module_dir=folder, use_ptx=False)
            assert any(path.suffix == ".cubin" for path in Path(folder).iterdir()), f"nothing for sm_{architecture}"


def kernels_of(dtype: torch.dtype, on_cuda: bool) -> list[wp.Kernel]:
    """One kernel of each kind that a card runs, arranged as for CUDA or not."""
    return [
        *(kernel for kind in ("parts", "total", "given") for kernel in shade_kernels(dtype, on_cuda, kind)),
        *consistency_kernels(dtype, on_cuda), arrival_kernel(dtype, on_cuda), spread_kernel(dtype),
        *splitsum_kernels(dtype, 5, 0.2, on_cuda), *lookup_kernels(dtype, on_cuda),
        code_kernel(dtype), *hit_kernels(dtype, on_cuda), *trace_kernels(dtype, on_cuda), *fit_kernels(dtype),
        *blend_kernels(dtype, 13, on_cuda)[:2], gather_kernel(dtype, 13), binning_kernels().entries,
        *geometry_kernels(dtype, on_cuda), *seen_kernels(dtype, on_cuda),
        *axes_kernels(dtype), *frame_kernels(dtype), *footprint_kernels(dtype), *harmonics_kernels(dtype),
        support_kernel(dtype), step_kernel(dtype, 1e-15),
        *term_kernels(dtype, on_cuda), *similarity_kernels(dtype, on_cuda), *display_kernels(dtype, on_cuda),
        *edge_kernels(dtype, on_cuda, widths=(3, 3, 1)), allowance_kernel(dtype, on_cuda),
        *point_kernels(dtype), *normal_kernels(dtype), surface_kernel(dtype, on_cuda),
    ]  # fmt: skip


def kernels_of_the_cpu() -> list[wp.Kernel]:
    """Kernels that no card runs, in float32."""
    return [sweep_kernel(torch.float32), sah_kernel(), binning_kernels().ordered, binning_kernels().listed]
