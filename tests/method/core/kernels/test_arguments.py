"""Kernels get the memory of tensors, and nothing that they do not declare; launches repeat with other arguments."""

import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import pytest
import torch
import warp as wp

from radiogs_core.errors import UsageError
from radiogs_core.kernels.arguments import Struct, packed
from radiogs_core.kernels.runtime import launch, launch_in_parallel, start_warp, use_threads

CPU = torch.device("cpu")

start_warp()


@wp.kernel(enable_backward=False, module="unique")
def added(first: wp.int32, points: wp.array(dtype=wp.vec3f), scale: wp.float32, out: wp.array(dtype=wp.float32)):
    place = first + wp.tid()
    out[place] += scale * (points[place][0] + 10.0 * points[place][1] + 100.0 * points[place][2])


@wp.kernel(enable_backward=False, module="unique")
def sized(
    first: wp.int32, points: wp.array(dtype=wp.vec3f), flags: wp.array(dtype=wp.bool), out: wp.array2d(dtype=int)
):
    out[0, 0] = points.shape[0] + 1000 * flags.shape[0]


@pytest.mark.parametrize("threads", [1, 2])
def test_vectors_are_items_and_results_are_written_to_the_tensor(threads: int) -> None:
    use_threads(threads)
    points = torch.arange(3 * 5000, dtype=torch.float32).view(5000, 3)
    for run in (launch, launch_in_parallel):
        out = torch.ones(5000, 1)
        given = [points, 2.0, out]
        run(added, 5000, CPU, given if run is launch else lambda _, given=given: given)
        expected = 1 + 2 * (points @ torch.tensor([1.0, 10.0, 100.0]))
        torch.testing.assert_close(out[:, 0], expected, rtol=0, atol=0)


def test_an_array_has_as_many_items_as_the_tensor_has_vectors() -> None:
    for count in (0, 1, 7):
        out = torch.zeros(1, 1, dtype=torch.int32)
        flags = torch.zeros(2 * count, dtype=torch.bool)
        launch(sized, 1, CPU, [torch.zeros(count, 3), flags, wp.from_torch(out)])
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
        packed(added, [points, 1.0, torch.zeros(4)])


def test_what_is_no_array_of_one_axis_takes_no_tensor() -> None:
    with pytest.raises(TypeError, match=r"'scale' of .* takes no tensor"):
        packed(added, [torch.zeros(4, 3), torch.zeros(1), torch.zeros(4)])
    with pytest.raises(TypeError, match=r"'out' of .* takes no tensor"):
        packed(sized, [torch.zeros(4, 3), torch.zeros(4, dtype=torch.bool), torch.zeros(1, 1, dtype=torch.int32)])


def test_a_tensor_of_too_many_entries_is_refused() -> None:
    huge = torch.empty(2**31, dtype=torch.uint8, device="meta")

    @wp.kernel(enable_backward=False, module="unique")
    def bytes_of(first: wp.int32, given: wp.array(dtype=wp.uint8)):
        given[first] = wp.uint8(0)

    with pytest.raises(UsageError, match="2147483648 entries of an array"):
        packed(bytes_of, [huge])


@wp.struct
class Scaled:
    factor: wp.float64
    shift: wp.vec2f
    flag: wp.bool
    points: wp.array(dtype=wp.vec3f)


@wp.kernel(enable_backward=False, module="unique")
def scaled(first: wp.int32, given: Scaled, power: wp.int32, out: wp.array(dtype=wp.float32)):
    place = first + wp.tid()
    point = given.points[place]
    total = wp.float32(given.factor) * (point[0] + 10.0 * point[1] + 100.0 * point[2])
    out[place] = total + given.shift[0] + 2.0 * given.shift[1] + wp.float32(power + given.points.shape[0])
    if given.flag:
        out[place] = -out[place]


def scaled_inputs(count: int, seed: int) -> dict[str, Any]:
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(seed))
    return {"factor": 0.5 + seed, "shift": (1.0 * seed, 3.0), "flag": seed % 2 == 1, "points": points}


def by_warp(given: dict[str, Any], power: int) -> torch.Tensor:
    """The kernel's result through Warp's own arrays, structs and launch."""
    struct, out = Scaled(), torch.zeros(len(given["points"]))
    struct.points = wp.from_torch(given["points"], dtype=wp.vec3f)
    struct.factor, struct.shift, struct.flag = given["factor"], wp.vec2f(*given["shift"]), given["flag"]
    wp.launch(scaled, dim=len(out), inputs=[0, struct, power, wp.from_torch(out)], device="cpu")
    return out


@pytest.mark.parametrize("threads", [1, 2])
def test_a_repeated_launch_does_what_a_new_one_does(threads: int) -> None:
    """With other sizes, addresses, numbers and structs from launch to launch."""
    use_threads(threads)
    for seed, count in enumerate((5, 1, 300, 0, 40)):
        given, out = scaled_inputs(count, seed), torch.zeros(count)
        arguments = [Struct(Scaled, **given), 7 * seed, out]
        launch_in_parallel(scaled, count, CPU, lambda _, arguments=arguments: arguments)
        assert torch.equal(out, by_warp(given, 7 * seed))


def test_threads_that_launch_the_same_kernel_at_once_do_not_mix_their_arguments() -> None:
    use_threads(1)
    expected = [by_warp(scaled_inputs(20_000 + thread, thread), thread) for thread in range(4)]

    def launches(thread: int) -> bool:
        given, out = Struct(Scaled, **scaled_inputs(20_000 + thread, thread)), torch.zeros(20_000 + thread)
        right = True
        together.wait()
        for _ in range(150):
            launch(scaled, len(out), CPU, [given, thread, out.zero_()])
            right &= torch.equal(out, expected[thread])
        return right

    together, interval = Barrier(4), sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            assert all(pool.map(launches, range(4)))
    finally:
        sys.setswitchinterval(interval)


def test_a_struct_is_refused_what_its_fields_do_not_take() -> None:
    given = scaled_inputs(4, 0)
    with pytest.raises(TypeError, match=r"'points' of Scaled takes .*float32.*, not torch.float64"):
        Struct(Scaled, **given | {"points": given["points"].double()})
    with pytest.raises(TypeError, match="with gaps"):
        Struct(Scaled, **given | {"points": torch.zeros(3, 4).mT})
    with pytest.raises(TypeError, match="'factor' of Scaled takes no tensor"):
        Struct(Scaled, **given | {"factor": torch.zeros(1)})
    with pytest.raises(TypeError, match="Scaled has the fields factor, shift, flag, points, not points"):
        Struct(Scaled, points=given["points"])
    with pytest.raises(UsageError, match="6442450944 entries of an array"):
        Struct(Scaled, **given | {"points": torch.empty(2**31, 3, device="meta")})


def test_a_kernel_takes_no_struct_of_another_kind() -> None:
    other = wp.struct(type("Other", (), {"__annotations__": {"factor": wp.float64}}))
    with pytest.raises(TypeError, match=r"incompatible types"):
        launch(scaled, 1, CPU, [Struct(other, factor=1.0), 1, torch.zeros(1)])
