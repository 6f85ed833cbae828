"""Every kernel is executed from the PTX that a card would get, by the tests of its results."""

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

TESTS = Path(__file__).parents[1]

KERNELS = (
    *(
        "adam",
        "axes",
        "brdf",
        "fit",
        "footprint",
        "harmonics",
        "hits",
        "image",
        "lookup",
        "rasterize",
        "shade",
        "terms",
    ),
    "trace",
)
OF_KERNELS = (
    *(f"method/core/kernels/test_{name}.py" for name in KERNELS), "method/core/transport/test_prefiltered_light.py",
)  # fmt: skip
"""Tests of what kernels compute."""

OF_THE_CPU = (
    "as_on_cpu",
    "on_card",
    "enters_more_nodes_than_fit",  # counts nodes that are visited breadth first
    "no_multiple_of_those_of_an_origin",  # rays of one origin
    "lanes_are_squeezed",  # instructions of AVX2
    "the_heuristic_visits",  # trees by the surface area
    "may_be_left_out_without_radiance",  # equal bits in two branches, which NVRTC rounds otherwise by 1e-16
    "good_to_the_last_digits",  # of lanes.inl; exp(log(x) / 2.4) of CUDA loses 61 units at 1e300
)
"""Parts of names of tests that hold for the CPU alone."""


@pytest.mark.slow
def test_every_kernel_computes_from_its_ptx_what_its_tests_expect_and_no_thread_disturbs_another(
    tmp_path: Path,
) -> None:
    """In both precisions, forward and backward."""
    paths = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    chosen = ["-m", "not slow", "-k", f"not ({' or '.join(OF_THE_CPU)})", "-q", "-p", "ptx.plugin", *OF_KERNELS]
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", *chosen],
        cwd=TESTS, env=os.environ | {"PYTHONPATH": paths, WHERE: str(tmp_path / "account.json")},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-5000:]
    account = json.loads((tmp_path / "account.json").read_text(encoding="utf-8"))
    assert not any(account["found"].values()), account["reports"]
    expected = {
        name_of(kernel) for dtype in (torch.float32, torch.float64) for kernel in kernels_of(dtype, on_cuda=True)
    }
    assert expected <= set(account["kernels"]), expected - set(account["kernels"])
    assert re.search(r"\d+ passed", ran.stdout)
