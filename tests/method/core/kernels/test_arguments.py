"""Kernels get the memory of tensors, and nothing that they do not declare."""

import pytest
import torch
import warp as wp

from radiogs_core.errors import UsageError
from radiogs_core.kernels.arguments import packed
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
