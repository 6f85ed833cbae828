"""Every kernel compiles: for CUDA on a machine that has none (NVRTC comes with Warp), for the CPU without a warning."""

from pathlib import Path

import pytest
import torch
import warp as wp

from radiogs_core.kernels.adam_source import step_kernel
from radiogs_core.kernels.image.depth_map_source import normal_kernels, point_kernels, surface_kernel
from radiogs_core.kernels.image.display_source import display_kernels
from radiogs_core.kernels.image.edges_source import allowance_kernel, edge_kernels
from radiogs_core.kernels.image.matching_source import sweep_kernel
from radiogs_core.kernels.image.similarity_source import similarity_kernels
from radiogs_core.kernels.image.terms_source import term_kernels
from radiogs_core.kernels.rasterize.binning_source import binning_kernels
from radiogs_core.kernels.rasterize.projection_source import geometry_kernels, seen_kernels
from radiogs_core.kernels.rasterize.rasterize_source import blend_kernels
from radiogs_core.kernels.shade.shade_source import arrival_kernel, consistency_kernels, shade_kernels, spread_kernel
from radiogs_core.kernels.shade.splitsum_source import lookup_kernels, splitsum_kernels
from radiogs_core.kernels.surfel.axes_source import axes_kernels
from radiogs_core.kernels.surfel.footprint_source import footprint_kernels, frame_kernels
from radiogs_core.kernels.surfel.harmonics_source import harmonics_kernels
from radiogs_core.kernels.surfel.support_source import support_kernel
from radiogs_core.kernels.trace.fit_source import fit_kernels
from radiogs_core.kernels.trace.hits_source import hit_kernels
from radiogs_core.kernels.trace.sah_source import sah_kernel
from radiogs_core.kernels.trace.trace_source import trace_kernels


def kernels_of(dtype: torch.dtype, on_cuda: bool) -> list[wp.Kernel]:
    splitsum, frames, binning, harmonics, shading, hits, tracing, blending, similarity, normals, edges = (
        splitsum_kernels(dtype, 5, 0.2, on_cuda),
        frame_kernels(dtype),
        binning_kernels(),
        harmonics_kernels(dtype),
        shade_kernels(dtype, on_cuda),
        hit_kernels(dtype, on_cuda),
        trace_kernels(dtype, on_cuda),
        blend_kernels(dtype, 13, on_cuda),
        similarity_kernels(dtype, on_cuda),
        normal_kernels(dtype),
        edge_kernels(dtype, on_cuda, widths=(3, 3, 1)),
    )
    footprints, display = footprint_kernels(dtype), display_kernels(dtype, on_cuda)
    axes = axes_kernels(dtype)
    projecting, seeing = geometry_kernels(dtype, on_cuda), seen_kernels(dtype, on_cuda)
    points, fits = point_kernels(dtype), fit_kernels(dtype)
    lookup, compared = lookup_kernels(dtype, on_cuda), consistency_kernels(dtype, on_cuda)
    totals = [shade_kernels(dtype, on_cuda, kind) for kind in ("total", "given")]
    terms = term_kernels(dtype, on_cuda)
    return [
        shading.forward, shading.backward, hits.code, hits.gather, hits.pack, tracing.forward, tracing.backward,
        blending.forward, blending.backward, binning.entries,
        harmonics.forward, harmonics.backward, frames.forward, frames.backward,
        splitsum.forward, splitsum.backward,
        similarity.forward, similarity.backward, normals.forward, normals.pull, normals.gather,
        allowance_kernel(dtype, on_cuda).forward, edges.forward, edges.backward,
        axes.forward, axes.backward, footprints.forward, footprints.backward, projecting.forward, projecting.backward,
        seeing.forward, seeing.backward, display.forward, display.backward,
        support_kernel(dtype), points.forward, points.backward, fits.leaves, fits.nodes,
        lookup.forward, lookup.backward, step_kernel(dtype, 1e-15), compared.forward, compared.backward,
        *(kernel for each in totals for kernel in (each.forward, each.backward)),
        arrival_kernel(dtype, on_cuda).arrive, spread_kernel(dtype),
        terms.forward, terms.backward, surface_kernel(dtype, on_cuda).forward,
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
    kernels = [*kernels_of(torch.float32, on_cuda), sweep_kernel(torch.float32), sah_kernel()]
    kernels += [binning_kernels().ordered, binning_kernels().listed]
    for place, kernel in enumerate(kernels):
        folder = tmp_path / str(place)
        folder.mkdir()
        wp.compile_aot_module(kernel.module, device="cpu", module_dir=folder)
        assert any(path.suffix == ".o" for path in folder.iterdir())
    assert "warning:" not in capfd.readouterr().err
