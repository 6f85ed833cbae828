"""Kernels get the memory of tensors, and nothing that they do not declare; launches repeat with other arguments."""

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import pytest
import torch
import warp as wp

from radiogs_core.errors import UsageError
from radiogs_core.kernels.runtime import launch, launch_in_parallel, start_warp, use_threads

CPU = torch.device("cpu")

start_warp()


@wp.kernel(enable_backward=False, module="unique")
def added(first: wp.int32, points: wp.array(dtype=wp.vec3f), scale: wp.float32, out: wp.array(dtype=wp.float32)):
    place = first + wp.tid()
    out[place] += scale * (points[place][0] + 10.0 * points[place][1] + 100.0 * points[place][2])


@wp.kernel(enable_backward=False, module="unique")
def sized(
    first: wp.int32, points: wp.array(dtype=wp.vec3f), flags: wp.array(dtype=wp.bool), out: wp.array(dtype=wp.int32)
):
    out[0] = points.shape[0] + 1000 * flags.shape[0]


@pytest.mark.parametrize("threads", [1, 2])
def test_vectors_are_items_and_results_are_written_to_the_tensor(threads: int) -> None:
    use_threads(threads)
    points = torch.arange(3 * 5000, dtype=torch.float32).view(5000, 3)
    for run in (launch, launch_in_parallel):
        out = torch.ones(5000, 1)
        given = [points, 2.0, out]
        run(added, 5000, CPU, given)
        expected = 1 + 2 * (points @ torch.tensor([1.0, 10.0, 100.0]))
        torch.testing.assert_close(out[:, 0], expected, rtol=0, atol=0)


def test_an_array_has_as_many_items_as_the_tensor_has_vectors() -> None:
    for count in (0, 1, 7):
        out = torch.zeros(1, dtype=torch.int32)
        flags = torch.zeros(2 * count, dtype=torch.bool)
        launch(sized, 1, CPU, [torch.zeros(count, 3), flags, out])
        assert int(out) == count + 2000 * count


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (torch.zeros(4, 3, dtype=torch.float64), "takes .*float32.*, not torch.float64"),
        (torch.zeros(4, 3, dtype=torch.int32), "not torch.int32"),
        (torch.zeros(3, 4).mT, "not torch.float32 with gaps"),
    ],
)
def test_a_tensor_of_another_type_or_with_gaps_is_refused(points: torch.Tensor, why: str) -> None:
    with pytest.raises(TypeError, match=f"'points' of .*{why}"):
        launch(added, 4, CPU, [points, 1.0, torch.zeros(4)])


def test_a_parameter_that_is_no_array_takes_no_tensor() -> None:
    with pytest.raises(TypeError, match=r"'scale' of .* takes no tensor"):
        launch(added, 4, CPU, [torch.zeros(4, 3), torch.zeros(1), torch.zeros(4)])


def test_a_tensor_of_too_many_entries_is_refused() -> None:
    huge = torch.empty(2**31, 3, device="meta")
    with pytest.raises(UsageError, match="6442450944 entries of an array"):
        launch(added, 4, CPU, [huge, 1.0, torch.zeros(4)])


@wp.kernel(enable_backward=False, module="unique")
def scaled(
    first: wp.int32, factor: wp.float64, shift: wp.vec2f, flag: wp.bool, points: wp.array(dtype=wp.vec3f),
    power: wp.int32, out: wp.array(dtype=wp.float32),
):  # fmt: skip
    place = first + wp.tid()
    point = points[place]
    total = wp.float32(factor) * (point[0] + 10.0 * point[1] + 100.0 * point[2])
    out[place] = total + shift[0] + 2.0 * shift[1] + wp.float32(power + points.shape[0])
    if flag:
        out[place] = -out[place]


def scaled_inputs(count: int, seed: int) -> list[Any]:
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed))
    return [0.5 + seed, wp.vec2f(1.0 * seed, 3.0), seed % 2 == 1, points]


def by_warp(given: list[Any], power: int) -> torch.Tensor:
    """The kernel's result through Warp's own arrays and launch."""
    *numbers, points = given
    out, tensor = torch.zeros(len(points)), wp.from_torch(points, dtype=wp.vec3f)
    wp.launch(scaled, dim=len(out), inputs=[0, *numbers, tensor, power, wp.from_torch(out)], device="cpu")
    return out


@pytest.mark.parametrize("threads", [1, 2])
def test_a_repeated_launch_does_what_a_new_one_does(threads: int) -> None:
    """With other sizes, addresses and numbers from launch to launch."""
    use_threads(threads)
    for seed, count in enumerate((5, 1, 300, 0, 40)):
        given, out = scaled_inputs(count, seed), torch.zeros(count)
        launch_in_parallel(scaled, count, CPU, [*given, 7 * seed, out])
        assert torch.equal(out, by_warp(given, 7 * seed))


def test_threads_that_launch_the_same_kernel_at_once_do_not_mix_their_arguments() -> None:
    use_threads(1)
    expected = [by_warp(scaled_inputs(20_000 + thread, thread), thread) for thread in range(4)]

    def launches(thread: int) -> bool:
        given, out = scaled_inputs(20_000 + thread, thread), torch.zeros(20_000 + thread)
        right = True
        together.wait()
        for _ in range(150):
            launch(scaled, len(out), CPU, [*given, thread, out.zero_()])
            right &= torch.equal(out, expected[thread])
        return right

    together, interval = Barrier(4), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            assert all(pool.map(launches, range(4)))
    finally:
        sys.setswitchinterval(interval)
