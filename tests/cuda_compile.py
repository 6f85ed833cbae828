"""Compiling kernels for CUDA on a machine without a GPU or its driver: NVRTC comes with Warp."""

from pathlib import Path
from tempfile import TemporaryDirectory

import warp as wp

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
