"""Every kernel compiles: for CUDA on a machine that has none (NVRTC comes with Warp), for the CPU without a warning."""

from pathlib import Path

import pytest
import torch
import warp as wp

from cuda_compile import kernels_of, kernels_of_the_cpu


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
    for place, kernel in enumerate([*kernels_of(torch.float32, on_cuda), *kernels_of_the_cpu()]):
        folder = tmp_path / str(place)
        folder.mkdir()
        wp.compile_aot_module(kernel.module, device="cpu", module_dir=folder)
        assert any(path.suffix == ".o" for path in folder.iterdir())
    assert "warning:" not in capfd.readouterr().err
