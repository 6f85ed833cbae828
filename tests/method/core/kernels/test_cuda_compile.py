"""Every kernel compiles: for CUDA on a machine that has none (NVRTC comes with Warp), for the CPU without a warning."""

from pathlib import Path

import pytest
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
from radiogs_core.kernels.rasterize.rasterize import blend_kernels
from radiogs_core.kernels.shade.consistency import consistency_kernels
from radiogs_core.kernels.shade.directions import spread_kernel
from radiogs_core.kernels.shade.lookup import lookup_kernels
from radiogs_core.kernels.shade.shade import arrival_kernel, shade_kernels
from radiogs_core.kernels.shade.splitsum import splitsum_kernels
from radiogs_core.kernels.surfel.axes import axes_kernels
from radiogs_core.kernels.surfel.footprint import footprint_kernels, frame_kernels
from radiogs_core.kernels.surfel.harmonics import harmonics_kernels
from radiogs_core.kernels.surfel.support import support_kernel
from radiogs_core.kernels.trace.bvh import fit_kernels
from radiogs_core.kernels.trace.hits import hit_kernels
from radiogs_core.kernels.trace.ray_order import code_kernel
from radiogs_core.kernels.trace.sah import sah_kernel
from radiogs_core.kernels.trace.trace import trace_kernels


def kernels_of(dtype: torch.dtype, on_cuda: bool) -> list[wp.Kernel]:
    return [
        *(kernel for kind in ("parts", "total", "given") for kernel in shade_kernels(dtype, on_cuda, kind)),
        *consistency_kernels(dtype, on_cuda), arrival_kernel(dtype, on_cuda), spread_kernel(dtype),
        *splitsum_kernels(dtype, 5, 0.2, on_cuda), *lookup_kernels(dtype, on_cuda),
        code_kernel(dtype), *hit_kernels(dtype, on_cuda), *trace_kernels(dtype, on_cuda), *fit_kernels(dtype),
        *blend_kernels(dtype, 13, on_cuda)[:2], binning_kernels().entries,
        *geometry_kernels(dtype, on_cuda), *seen_kernels(dtype, on_cuda),
        *axes_kernels(dtype), *frame_kernels(dtype), *footprint_kernels(dtype), *harmonics_kernels(dtype),
        support_kernel(dtype), step_kernel(dtype, 1e-15),
        *term_kernels(dtype, on_cuda), *similarity_kernels(dtype, on_cuda), *display_kernels(dtype, on_cuda),
        *edge_kernels(dtype, on_cuda, widths=(3, 3, 1)), allowance_kernel(dtype, on_cuda),
        *point_kernels(dtype), *normal_kernels(dtype), surface_kernel(dtype, on_cuda),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("architecture", "dtype"),
    [
        (80, torch.float64),
        (90, torch.float32),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((80, torch.float32), (89, torch.float32), (89, torch.float64), (90, torch.float64))
        ),
    ],
)
def test_kernels_compile_for_cuda(architecture: int, dtype: torch.dtype, tmp_path: Path) -> None:
    for place, kernel in enumerate(kernels_of(dtype, on_cuda=True)):
        folder = tmp_path / str(place)
        folder.mkdir()
        wp.compile_aot_module(kernel.module, arch=architecture, module_dir=folder, use_ptx=True)
        assert any(path.suffix == ".ptx" for path in folder.iterdir())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:compile_aot_module:UserWarning")  # of -march=native
@pytest.mark.parametrize("on_cuda", [False, True])
def test_kernels_compile_for_the_cpu_without_a_warning(
    on_cuda: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """In float32; what is arranged for CUDA compiles for the CPU as well. Clang writes past ``sys.stderr``."""
    on_the_cpu = sweep_kernel(torch.float32), sah_kernel(), binning_kernels().ordered, binning_kernels().listed
    kernels = [*kernels_of(torch.float32, on_cuda), *on_the_cpu]
    for place, kernel in enumerate(kernels):
        folder = tmp_path / str(place)
        folder.mkdir()
        wp.compile_aot_module(kernel.module, device="cpu", module_dir=folder)
        assert any(path.suffix == ".o" for path in folder.iterdir())
    assert "warning:" not in capfd.readouterr().err
