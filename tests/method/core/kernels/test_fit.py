"""Boxes and leaves of a fitted tree against surfels taken one by one."""

import math

import pytest
import torch
from torch import Tensor

from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.trace.bvh import COORDINATE_PADDING, EMPTY, RELATIVE_PADDING, SurfelBVH
from radiogs_core.kernels.trace.topology import kd_topology

in_every_arrangement = pytest.mark.usefixtures("arrangement")


def surfels(count: int, dtype: torch.dtype = torch.float64) -> SplatGeometry:
    """Surfels with skewed axes; of eleven in a row, five that no ray can meet."""
    frame = torch.linalg.qr(torch.randn(count, 3, 3, dtype=torch.float64)).Q
    axes = frame[..., :2] / (0.02 + 0.1 * torch.rand(count, 1, 2, dtype=torch.float64))
    centre, normal = torch.randn(count, 3, dtype=torch.float64), frame[..., 2].clone()
    axis_u, axis_v = axes[..., 0] + 0.5 * axes[..., 1], axes[..., 1].clone()
    opacity = 0.01 + 0.98 * torch.rand(count, dtype=torch.float64)
    centre[3::11, 1] = torch.nan
    axis_u[5::11] = 0
    axis_v[6::11, 2] = torch.inf
    opacity[8::11] = 0.003
    normal[10::11, 0] = torch.nan
    return SplatGeometry(*(value.to(dtype) for value in (centre, axis_u, axis_v, normal, opacity)))


def is_met(surfel: int) -> bool:
    return surfel >= 0 and surfel % 11 not in (3, 5, 6, 8, 10)


def reach(geometry: SplatGeometry, surfel: int) -> float:
    return math.sqrt(2 * math.log(255 * float(geometry.opacity[surfel])))


def box_of(geometry: SplatGeometry, surfel: int, padded: bool) -> Tensor:
    """Low and high corner of what is stronger than one grey level, in float64."""
    axes = torch.stack([geometry.axis_u[surfel], geometry.axis_v[surfel]]).double()
    half = reach(geometry, surfel) * torch.linalg.pinv(axes).norm(dim=1)
    middle = geometry.centre[surfel].double()
    if padded:
        half = half + RELATIVE_PADDING * half.max() + COORDINATE_PADDING * middle.abs()
    return torch.stack([middle - half, middle + half])


def around(boxes: list[Tensor]) -> Tensor:
    """The box around boxes; around none, the one that no ray meets."""
    if not boxes:
        return torch.tensor([[EMPTY], [-EMPTY]], dtype=torch.float64).expand(2, 3)
    return torch.stack([torch.stack(boxes)[:, 0].amin(0), torch.stack(boxes)[:, 1].amax(0)])


def children_of(tree: SurfelBVH, node: int) -> list[Tensor]:
    """The boxes that a node stores of its children."""
    return list(tree.boxes[node].view(2, 3, 8).double().movedim(2, 0))


def boxes_in_leaves(tree: SurfelBVH, geometry: SplatGeometry, padded: bool) -> list[Tensor]:
    """The box of each leaf's surfels, then the empty box of children that are absent."""
    members = [[surfel for surfel in leaf if is_met(surfel)] for leaf in tree.topology.order.tolist()]
    return [around([box_of(geometry, surfel, padded) for surfel in leaf]) for leaf in [*members, []]]


def fitted(geometry: SplatGeometry) -> SurfelBVH:
    """A tree built over other surfels, then fitted to these."""
    tree = SurfelBVH.build(surfels(len(geometry), geometry.centre.dtype))
    topology = tree.topology
    tree.visits_when_built = math.inf
    tree.refit(geometry)
    assert tree.topology is topology
    return tree


@in_every_arrangement
@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 1000])
def test_a_node_stores_the_padded_boxes_of_its_leaves_and_the_boxes_around_those_of_its_nodes(count: int) -> None:
    geometry = surfels(count)
    tree = fitted(geometry)
    of_leaves = boxes_in_leaves(tree, geometry, padded=True)
    for node, children in enumerate(tree.topology.child.tolist()):
        for child, stored in zip(children, children_of(tree, node), strict=True):
            if child >= 0:
                assert torch.equal(stored, around(children_of(tree, child)))
            else:
                torch.testing.assert_close(stored, of_leaves[-1 - child], rtol=1e-12, atol=1e-12)


@in_every_arrangement
def test_boxes_in_float32_contain_what_their_surfels_reach_and_little_more() -> None:
    geometry = surfels(1000, torch.float32)
    tree = fitted(geometry)
    of_leaves = boxes_in_leaves(tree, geometry, padded=False)
    for node, children in enumerate(tree.topology.child.tolist()):
        for child, (low, high) in zip(children, children_of(tree, node), strict=True):
            if child < 0 and of_leaves[-1 - child][0, 0] < EMPTY:
                exact_low, exact_high = of_leaves[-1 - child]
                assert ((low < exact_low) & (high > exact_high)).all()
                torch.testing.assert_close(torch.stack([low, high]), of_leaves[-1 - child], rtol=1e-5, atol=2e-5)


@in_every_arrangement
@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 1000])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_leaves_hold_their_surfels_and_zero_where_none_can_be_met(count: int, dtype: torch.dtype) -> None:
    geometry = surfels(count, dtype)
    tree = fitted(geometry)
    assert sorted(tree.topology.order[tree.topology.order >= 0].tolist()) == list(range(count))
    for members, records in zip(tree.topology.order.tolist(), tree.leaves, strict=True):
        for surfel, record in zip(members, records.mT, strict=True):
            if not is_met(surfel):
                assert (record == 0).all()
                continue
            vectors = [getattr(geometry, name)[surfel] for name in ("centre", "axis_u", "axis_v", "normal")]
            assert torch.equal(record[:13], torch.cat([*vectors, geometry.opacity[surfel, None]]))
            assert float(record[13]) == pytest.approx(reach(geometry, surfel) ** 2, rel=1e-5)


@in_every_arrangement
@pytest.mark.parametrize("count", [1, 1000])
def test_expected_visits_are_all_box_areas_over_the_root_area(count: int) -> None:
    tree = fitted(surfels(count))

    def area(box: Tensor) -> float:
        x, y, z = (box[1] - box[0]).clamp(min=0).tolist()
        return 2 * (x * y + y * z + z * x)

    total = sum(area(box) for node in range(len(tree.boxes)) for box in children_of(tree, node))
    assert tree.expected_visits == pytest.approx(total / area(around(children_of(tree, 0))), rel=1e-12)


@in_every_arrangement
def test_a_tree_of_unhittable_surfels_is_never_visited() -> None:
    geometry = surfels(100)
    geometry.opacity[:] = 0.003
    tree = fitted(geometry)
    assert tree.expected_visits == 0
    assert (tree.boxes.view(-1, 2, 24) == torch.tensor([[EMPTY], [-EMPTY]], dtype=torch.float64)).all()
    assert (tree.leaves == 0).all()


@pytest.mark.usefixtures("cpu_arrangement")
def test_fits_do_not_depend_on_the_number_of_threads() -> None:
    geometry, trees = surfels(1000, torch.float32), []
    topology = kd_topology(surfels(1000).centre.nan_to_num())
    for team in (1, 2, 3):
        use_threads(team)
        trees.append(SurfelBVH.build(geometry, topology))
    for other in trees[1:]:
        assert torch.equal(other.boxes, trees[0].boxes)
        assert torch.equal(other.leaves, trees[0].leaves)
        assert other.expected_visits == trees[0].expected_visits
