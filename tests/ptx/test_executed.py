"""Every kernel is executed from the PTX that a card of compute capability 8.0 would get, by the tests of its results."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from cuda_compile import kernels_of
from ptx.launch import name_of
from ptx.plugin import WHERE

ROOT = Path(__file__).parents[2]

OF_KERNELS = (
    *(f"kernels/test_{name}.py" for name in ("adam", "axes", "brdf", "fit", "footprint", "harmonics", "hits", "image")),
    *(f"kernels/test_{name}.py" for name in ("lookup", "rasterize", "shade", "terms", "trace")),
)
"""Tests of what kernels compute."""


@pytest.mark.slow
def test_every_kernel_computes_from_its_ptx_what_its_tests_expect_and_no_thread_disturbs_another(tmp_path: Path) -> None:
    """In both precisions, forward and backward; tests of sizes of launches and of threads of the CPU are left out."""
    listed = [f"tests/method/core/{name}" for name in OF_KERNELS]
    chosen = ["-m", "not slow", "-k", "not as_on_cpu and not on_card", "-q", "--no-header", "-p", "ptx.plugin"]
    paths = os.pathsep.join([str(ROOT / "tests"), *filter(None, [os.environ.get("PYTHONPATH")])])
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", *chosen, *listed],
        cwd=ROOT, env=os.environ | {"PYTHONPATH": paths, WHERE: str(tmp_path / "account.json")},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-5000:]
    account = json.loads((tmp_path / "account.json").read_text(encoding="utf-8"))
    assert not any(account["found"].values()), account["reports"]
    expected = {name_of(kernel) for dtype in (torch.float32, torch.float64) for kernel in kernels_of(dtype, True)}
    assert set(account["kernels"]) >= expected, expected - set(account["kernels"])
    assert int(re.search(r"(\d+) passed", ran.stdout)[1]) > 0
