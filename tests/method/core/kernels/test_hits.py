"""Breadth-first and nearest-first gathering of a ray's hits find the same hits."""

from pathlib import Path

import pytest
import torch

from radiogs_core.errors import UsageError
from radiogs_core.instruments import recording
from radiogs_core.kernels.arrangement import cpu_as_cuda
from radiogs_core.kernels.lanes import LANES
from radiogs_core.kernels.native_kernel import INTEGERS, NativeFile, native_kernel
from radiogs_core.kernels.runtime import launch, use_threads
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.hits import BUFFER, MOST_HITS, MOST_NODES, HitLists, find_hits

RAYS = 40


def facing(distance: torch.Tensor, opacity: float, turned: torch.Tensor | None = None) -> SplatGeometry:
    """Surfels across the X axis at ``distance``, wide enough for all ``rays``, which see them from behind if turned."""
    count = len(distance)
    axes = torch.eye(3).expand(count, 3, 3)
    side = torch.full((count,), -1.0) if turned is None else torch.where(turned, 1.0, -1.0)
    centre = distance[:, None] * axes[:, 0]
    return SplatGeometry(
        centre,
        axes[:, 1].contiguous(),
        axes[:, 2].contiguous(),
        side[:, None] * axes[:, 0],
        torch.full((count,), opacity),
    )


def rays() -> tuple[torch.Tensor, torch.Tensor]:
    """Origins near zero and directions of travel along X."""
    origin = torch.cat([torch.zeros(RAYS, 1), 0.3 * torch.rand(RAYS, 2)], 1)
    return origin, torch.eye(3)[:1].expand(RAYS, 3).contiguous()


def hits_of(geometry: SplatGeometry, t_min: float, stop: float) -> tuple[HitLists, int, HitLists, int]:
    """Hits and visited nodes: breadth first, then nearest first, which is how work is arranged for CUDA."""
    tree, (origin, direction) = SurfelBVH.build(geometry), rays()
    start, nowhere = torch.full((RAYS,), t_min), torch.full((RAYS,), torch.inf)
    with recording() as ours:
        breadth_first = find_hits(tree, origin, direction, start, nowhere, stop)
    with recording() as theirs, cpu_as_cuda():
        nearest_first = find_hits(tree, origin, direction, start, nowhere, stop)
    return breadth_first, ours.work["node_visits"], nearest_first, theirs.work["node_visits"]


def assert_equal(one: HitLists, other: HitLists) -> None:
    assert torch.equal(one.ray, other.ray)
    assert torch.equal(one.begin, other.begin)
    assert torch.equal(one.surfel, other.surfel)
    torch.testing.assert_close(one.depth, other.depth, rtol=1e-6, atol=0)
    torch.testing.assert_close(one.alpha, other.alpha, rtol=1e-5, atol=0)


@pytest.mark.parametrize("met", [0, 1, 7, 8, 9, BUFFER, BUFFER + 1, MOST_HITS, MOST_HITS + 1, 3 * MOST_HITS])
def test_any_number_of_hits_is_found_in_order(met: int) -> None:
    distance = 1 + torch.rand(met)
    distance[::3] = 1.5  # ties, which surfels' numbers decide
    ours, _, theirs, _ = hits_of(facing(distance, 0.006), 0.0, 1e-6)
    assert_equal(ours, theirs)
    begin = ours.begin.tolist()
    by_distance = sorted(range(met), key=lambda surfel: (float(distance[surfel]), surfel))
    assert all(ours.surfel[begin[k] : begin[k + 1]].tolist() == by_distance for k in range(RAYS))


@pytest.mark.parametrize("layers", [MOST_HITS, 4000])
def test_surfels_behind_an_opaque_surface_are_not_hit(layers: int) -> None:
    ours, _, theirs, _ = hits_of(facing(torch.linspace(1, 50, layers), 0.9), 0.0, 0.03)
    assert_equal(ours, theirs)
    assert 1 < int(ours.begin.diff().min()) <= int(ours.begin.diff().max()) < 8


def test_a_hit_where_a_ray_begins_is_passed() -> None:
    ours, _, theirs, _ = hits_of(facing(torch.tensor([0.5, 1.0, 1.0, 1.25]), 0.2), 1.0, 0.03)
    assert_equal(ours, theirs)
    assert ours.surfel.unique().tolist() == [3]


def test_a_ray_that_enters_more_nodes_than_fit_is_followed_nearest_first() -> None:
    """Surfels that it passes from behind, and three that it meets."""
    distance = torch.linspace(1, 100, 40 * MOST_NODES)
    turned = torch.ones(len(distance), dtype=torch.bool)
    turned[[5, len(distance) // 2, len(distance) - 1]] = False
    ours, nodes, theirs, same = hits_of(facing(distance, 0.2, turned), 0.0, 0.03)
    assert same > MOST_NODES * RAYS
    assert nodes > same, "those that were given up count as well"
    assert_equal(ours, theirs)
    assert ours.begin.diff().tolist() == [3] * RAYS


def scattered(count: int, extent: float) -> SplatGeometry:
    """Surfels of unit width in random orientation, in a ball of about the width ``extent``."""
    frame = torch.linalg.qr(torch.randn(count, 3, 3)).Q
    centre = extent * torch.randn(count, 3)
    return SplatGeometry(centre, *(frame[..., k].contiguous() for k in range(3)), 0.05 + 0.9 * torch.rand(count))


def from_points(points: int, of_origin: int, away: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Origins and directions of travel of ``of_origin`` consecutive rays from each of some points, which lie ``away``
    from zero and look about there."""
    point = away * torch.nn.functional.normalize(torch.randn(points, 3), dim=-1)
    origin = point.repeat_interleave(of_origin, 0)
    return origin, torch.nn.functional.normalize(3 * torch.randn(points * of_origin, 3) - origin, dim=-1)


def by_ray(lists: HitLists) -> HitLists:
    """The same lists in the order of the rays."""
    place = lists.ray.long().argsort()
    counts = lists.begin.diff()[place]
    begin = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
    entry = torch.arange(len(lists.surfel)) + (lists.begin[:-1][place] - begin[:-1]).repeat_interleave(counts)
    fields = (lists.surfel[entry], lists.depth[entry], lists.alpha[entry])
    return HitLists(lists.ray[place], begin.to(lists.begin.dtype), *fields)


@pytest.mark.parametrize("team", [1, 2])
@pytest.mark.parametrize("of_origin", [1, 15, 16, 63, 64, 65, 130])
def test_rays_of_one_origin_hit_what_each_hits_by_itself(of_origin: int, team: int) -> None:
    use_threads(team)
    tree = SurfelBVH.build(scattered(301, 3.0))
    origin, direction = from_points(40, of_origin, 4.0)
    start, backs = torch.full((len(origin),), 0.5), torch.full((len(origin),), 5.0)
    together, apart = (find_hits(tree, origin, direction, start, backs, 0.03, each) for each in (of_origin, 1))
    assert 1 < len(together.surfel) / len(origin) < 100
    assert_equal(by_ray(together), by_ray(apart))


@pytest.mark.parametrize(("away", "shift"), [(1000.0, 0.0), (4.0, 1000.0)])
def test_rays_of_a_distant_origin_are_as_exact_together_as_apart(away: float, shift: float) -> None:
    """Far from the surfels, or beside them and far from zero."""
    surfels, (origin, direction) = scattered(300, 3.0), from_points(20, 64, away)
    surfels.centre.add_(shift)
    origin += shift
    start, backs = torch.zeros(len(origin)), torch.full((len(origin),), torch.inf)
    exact = {"origin": origin.double(), "direction": direction.double()}
    tree = SurfelBVH.build(surfels)
    errors = []
    for each in (64, 1):
        lists = by_ray(find_hits(tree, origin, direction, start, backs, 1e-6, each))
        ray, surfel = lists.ray.long().repeat_interleave(lists.begin.diff()), lists.surfel.long()
        way, normal = exact["direction"][ray], surfels.normal[surfel].double()
        off = exact["origin"][ray] - surfels.centre[surfel].double()
        depth = -(normal * off).sum(-1) / (normal * way).sum(-1)
        point = off + depth[:, None] * way
        axes = (surfels.axis_u[surfel].double(), surfels.axis_v[surfel].double())
        square = sum((axis * point).sum(-1).square() for axis in axes)
        errors.append((surfels.opacity[surfel] * torch.exp(-square / 2) - lists.alpha).abs())
    together, apart = errors
    assert len(together) > 1000
    assert float(together.mean()) < 2 * float(apart.mean()) < 1e-3


def test_rays_that_are_no_multiple_of_those_of_an_origin_are_refused() -> None:
    tree, (origin, direction) = SurfelBVH.build(scattered(20, 1.0)), from_points(1, 40, 4.0)
    start = torch.zeros(40)
    with pytest.raises(UsageError, match="no multiple"):
        find_hits(tree, origin, direction, start, start, 0.03, 32)


PROCESSORS = {"this": "-march=native", "AVX2": "-target-cpu haswell", "neither": "-target-cpu nehalem"}


def processor_flags() -> str:
    """The features that the processor reports, on Linux."""
    about = Path("/proc/cpuinfo")
    return about.read_text(encoding="utf-8") if about.exists() else ""


@pytest.mark.parametrize("processor", PROCESSORS)
def test_lanes_are_squeezed_alike_with_every_instruction_set(processor: str) -> None:
    if processor != "this" and " avx2 " not in processor_flags():
        pytest.skip("this processor does not run the instructions of the other")
    text = (
        LANES.sections["squeeze"]
        + """
        const Eight together = squeezed(Eight{3, 1, 4, 1, 5, 9, 2, 6}, bits);
        for (int lane = 0; lane < 8; ++lane) out.data[8 * bits + lane] = together[lane];
    """
    )
    file, options = NativeFile("squeezed", {"all": text}), {"cpu_compiler_flags": PROCESSORS[processor]}
    kernel = native_kernel(file, torch.float32, options, "all", "bits", (INTEGERS, "out"))
    found = torch.zeros(256, 8, dtype=torch.int32)
    launch(kernel, 256, found.device, [found])
    values = [3, 1, 4, 1, 5, 9, 2, 6]
    for bits, row in enumerate(found.tolist()):
        kept = [value for lane, value in enumerate(values) if bits >> lane & 1]
        assert row[: len(kept)] == kept
