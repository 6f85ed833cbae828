import itertools

import pytest
import torch

from radiogs_core.surfels.swept_depth import DepthSweep, SmallView, aggregated, lowest, swept_depths
from scenes import sphere_scene

STEP, JUMP = 0.3, 0.7
SMALL = DepthSweep(planes=32, neighbours=4, agreeing=2)


def cheapest(cost: torch.Tensor, end: int, line: torch.Tensor) -> list[float]:
    """Costs of the cheapest paths that end at place ``end`` of a line, for each plane there, by trying all paths.

    ``cost`` [planes, length]; ``line``: whether each place is covered. A path begins behind the last uncovered one."""
    costs = cost.tolist()
    begin = max([place + 1 for place in range(end) if not line[place]], default=0)
    best = [float("inf")] * len(cost)
    for planes in itertools.product(range(len(cost)), repeat=end - begin + 1):
        own = sum(costs[plane][begin + place] for place, plane in enumerate(planes))
        changes = [abs(a - b) for a, b in itertools.pairwise(planes)]
        turns = sum(0.0 if change == 0 else STEP if change == 1 else JUMP for change in changes)
        best[planes[-1]] = min(best[planes[-1]], own + turns)
    return best


def test_aggregated_costs_are_those_of_the_cheapest_of_all_paths_from_four_sides() -> None:
    cost = torch.rand(4, 3, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    covered = torch.ones(3, 4, dtype=torch.bool)
    covered[1, 2] = covered[2, 0] = False
    found = aggregated(cost, covered, STEP, JUMP)
    for row, column in itertools.product(range(3), range(4)):
        across, down = (cost[:, row], covered[row], column), (cost[:, :, column], covered[:, column], row)
        lines = [(across[0], column, across[1]), (across[0].flip(1), 3 - column, across[1].flip(0))]
        lines += [(down[0], row, down[1]), (down[0].flip(1), 2 - row, down[1].flip(0))]
        expected = torch.tensor([cheapest(*line) for line in lines], dtype=torch.float64).sum(0)
        here = found[:, row, column]
        # Costs are known up to a constant of the pixel, which no choice among its planes depends on.
        torch.testing.assert_close(here - here.min(), expected - expected.min())


def test_the_lowest_cost_is_found_between_planes() -> None:
    planes = torch.linspace(2.0, 4.0, 21)
    truth = torch.tensor([[2.63, 3.11], [3.5, 3.94]])
    parabolas = (planes[:, None, None] - truth).square()
    torch.testing.assert_close(lowest(parabolas, planes), truth.clamp(max=3.95))


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_depths_of_a_sphere_are_its_own_at_any_scale_of_the_world(scale: float) -> None:
    scene = sphere_scene(views=12, size=48, scale=scale)
    views = [SmallView.of(view, 24) for view in scene.train]
    assert views[0].colour.shape == (3, 24, 24)  # averaged over two by two pixels
    depths = swept_depths(views, scene.centre.float(), 1.2 * scale, SMALL)
    errors = []
    for view, depth in zip(views, depths, strict=True):
        assert bool((depth[~view.covered] == 0).all())
        points = view.camera.centre + view.camera.ray_directions() * depth[..., None]
        errors.append((points[view.covered].norm(dim=-1) / scale - 1).abs())
    assert float(torch.cat(errors).median()) < 0.06  # planes are 0.08 apart


def test_a_single_view_has_no_depth() -> None:
    scene = sphere_scene(views=2, size=16)
    only = [SmallView.of(scene.train[0], 16)]
    assert not bool(swept_depths(only, scene.centre.float(), 1.2, DepthSweep())[0].any())
