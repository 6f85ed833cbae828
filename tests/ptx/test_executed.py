"""Every kernel is executed from the PTX that a card would get, by the tests of its results."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from cuda_compile import kernels_of
from ptx.launch import launched_from_ptx, name_of
from ptx.machine import Account
from ptx.plugin import WHERE
from radiogs.initialise import Initialisation
from radiogs.learning import MaterialLearning, MaterialStart
from radiogs.method import inverse_rendering
from radiogs.settings import Variant
from radiogs_core.contract import Run
from radiogs_core.kernels.arrangement import cpu_as_cuda
from radiogs_core.plain_values import with_values
from short_training import BUDGET, CPU, SCENE, through_a_file

TESTS = Path(__file__).parents[1]

KERNELS = (
    "adam", "axes", "brdf", "fit", "footprint", "harmonics", "hits", "image", "lookup", "rasterize", "shade",
    "single_precision", "terms", "trace",
)  # fmt: skip
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

VARIANT = Variant(materials=MaterialLearning(start=MaterialStart(light="constant")))
FEW_STEPS = with_values(BUDGET, {"geometry.steps": 2, "inverse_iterations": 2})


def learnt() -> dict[str, torch.Tensor]:
    """All tensors after two steps of each stage, in float32."""
    torch.manual_seed(0)
    first = Initialisation(Run(SCENE, VARIANT, FEW_STEPS, 0, CPU))
    while first.iteration < first.iterations:
        first.step()
    second = inverse_rendering(Run(SCENE, VARIANT, FEW_STEPS, 0, CPU), through_a_file(first.state()))
    while second.iteration < second.iterations:
        second.step()
    return {name: value.detach() for name, value in second.optimiser.tensors.items()}


def account_of_tests(folder: Path) -> dict[str, Any]:
    """The account of the tests of kernels, all of which have to pass."""
    paths = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    chosen = ["-m", "not slow", "-k", f"not ({' or '.join(OF_THE_CPU)})", "-q", "-p", "ptx.plugin", *OF_KERNELS]
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", *chosen],
        cwd=TESTS, env=os.environ | {"PYTHONPATH": paths, WHERE: str(folder / "account.json")},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-5000:]
    return json.loads((folder / "account.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_every_kernel_computes_from_its_ptx_what_is_expected_and_no_thread_disturbs_another(tmp_path: Path) -> None:
    """In both precisions, forward and backward: by the tests of kernels, and by two steps of each stage of RadioGS."""
    account = Account()
    with launched_from_ptx(account, seed=1):
        found = learnt()
    with cpu_as_cuda():
        expected = learnt()
    for name, value in expected.items():
        torch.testing.assert_close(found[name], value, rtol=1e-5, atol=1e-6, msg=name)
    of_tests = account_of_tests(tmp_path)
    assert not any([*account.found.values(), *of_tests["found"].values()]), [*account.reports, *of_tests["reports"]][
        :20
    ]
    every = {name_of(kernel) for dtype in (torch.float32, torch.float64) for kernel in kernels_of(dtype, on_cuda=True)}
    assert every == {*account.kernels, *of_tests["kernels"]}
