"""K2 against a dense float64 implementation, finite differences, ties, and closed shells."""

from collections.abc import Callable

import pytest
import torch

from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.surfel.geometry import MAX_ALPHA, SplatGeometry
from radiogs_core.kernels.trace.bvh import LOOSENED, SurfelBVH
from radiogs_core.kernels.trace.hits import find_hits
from radiogs_core.kernels.trace.topology import DEEPEST, kd_topology
from radiogs_core.kernels.trace.trace import Hits, trace
from reference.differences import Values, assert_gradients, assert_same_slopes, gradients_of
from reference.trace import trace as dense_trace

FIELDS = ("centre", "axis_u", "axis_v", "normal", "opacity", "sh", "features", "origin")

in_every_arrangement = pytest.mark.usefixtures("arrangement")
OUTPUTS = ("radiance", "transmittance", "features", "depth")
Blended = tuple[torch.Tensor, ...]


def random_inputs(surfels: int, rays: int, channels: int, coefficients: int = 16) -> Values:
    frame = torch.linalg.qr(torch.randn(surfels, 3, 3, dtype=torch.float64)).Q
    scale = 0.3 + 0.5 * torch.rand(surfels, 2, dtype=torch.float64)
    return {
        "centre": torch.randn(surfels, 3, dtype=torch.float64),
        "axis_u": frame[..., 0] / scale[:, :1],
        "axis_v": frame[..., 1] / scale[:, 1:],
        "normal": frame[..., 2].contiguous(),
        "opacity": torch.rand(surfels, dtype=torch.float64),
        "sh": 0.5 * torch.randn(surfels, coefficients, 3, dtype=torch.float64),
        "features": torch.rand(surfels, channels, dtype=torch.float64),
        "origin": torch.randn(rays, 3, dtype=torch.float64),
        "direction": torch.nn.functional.normalize(torch.randn(rays, 3, dtype=torch.float64), dim=-1),
        "t_min": 0.2 * torch.rand(rays, dtype=torch.float64),
    }


def fast(given: Values, stop: float = 0.03) -> Blended:
    geometry = splats(given)
    hits = trace(
        SurfelBVH.build(geometry), geometry, given["sh"], given["features"], given["origin"], given["direction"],
        given["t_min"], stop,
    )  # fmt: skip
    return tuple(getattr(hits, name) for name in OUTPUTS)


def dense(given: Values, stop: float = 0.03) -> Blended:
    return dense_trace(*given.values(), stop)


def gradients(function: Callable[[Values], Blended], given: Values, pulls: list[torch.Tensor]) -> Values:
    return gradients_of(function, given, pulls, FIELDS)


@in_every_arrangement
@pytest.mark.parametrize(("channels", "coefficients"), [(0, 1), (7, 16), (1, 4)])
def test_float64_equals_the_dense_result_and_its_gradients(channels: int, coefficients: int) -> None:
    given = random_inputs(60, 100, channels, coefficients)
    found, expected = fast(given), dense(given)
    for name, ours, theirs in zip(OUTPUTS, found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-12, msg=name)
    assert float((found[1] < 0.9).double().mean()) > 0.3, "the rays should meet something"
    pulls = [torch.randn_like(value) for value in found]
    assert_same_slopes(gradients(fast, given, pulls), gradients(dense, given, pulls))


@in_every_arrangement
def test_an_opacity_that_is_cut_off_at_its_largest_value_has_no_gradient() -> None:
    given = random_inputs(60, 100, 3)
    given |= {name: 0.02 * given[name] for name in ("axis_u", "axis_v")}
    given["opacity"] = torch.ones_like(given["opacity"])
    tree, nowhere = SurfelBVH.build(splats(given)), torch.full_like(given["t_min"], torch.inf)
    met = find_hits(tree, given["origin"], given["direction"], given["t_min"], nowhere, 0.0001).alpha
    assert 0.2 < float((met == MAX_ALPHA).double().mean()) < 1, "some are cut off, and some are not"
    found = fast(given, 0.0001)
    pulls = [torch.randn_like(value) for value in found]
    assert_same_slopes(*(gradients(lambda of, trace=trace: trace(of, 0.0001), given, pulls) for trace in (fast, dense)))


@in_every_arrangement
def test_from_a_distance_on_backs_are_met_and_are_black() -> None:
    given, back_from = random_inputs(60, 100, 3), 0.8

    def ours_of(given: Values) -> Blended:
        geometry = splats(given)
        backs = torch.full_like(given["t_min"], back_from)
        hits = trace(
            SurfelBVH.build(geometry), geometry, given["sh"], given["features"], given["origin"], given["direction"],
            given["t_min"], back_from=backs,
        )  # fmt: skip
        return tuple(getattr(hits, name) for name in OUTPUTS)

    def theirs_of(given: Values) -> Blended:
        return dense_trace(*given.values(), 0.03, back_from)

    found, expected, from_the_front = ours_of(given), theirs_of(given), dense(given)
    for name, ours, theirs in zip(OUTPUTS, found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-12, msg=name)
    assert float((found[1] < from_the_front[1] - 0.01).double().mean()) > 0.2, "backs should be met"
    pulls = [torch.randn_like(value) for value in found]
    assert_same_slopes(gradients(ours_of, given, pulls), gradients(theirs_of, given, pulls))


def hit_by_each(given: Values) -> list[list[int]]:
    """The surfels that each ray blends, in order."""
    tree = SurfelBVH.build(splats(given))
    lists = find_hits(
        tree, given["origin"], given["direction"], given["t_min"], torch.full_like(given["t_min"], torch.inf), 0.03
    )
    begin, members = lists.begin.tolist(), lists.surfel.tolist()
    place = {ray: slot for slot, ray in enumerate(lists.ray.tolist())}
    return [members[begin[place[ray]] : begin[place[ray] + 1]] for ray in range(len(place))]


def test_gradients_equal_central_differences_in_random_directions() -> None:
    use_threads(1)
    given = random_inputs(30, 40, 2)
    pulls = [torch.randn_like(value) for value in fast(given)]

    def total(values: Values) -> float:
        return float(sum((out * pull).sum() for out, pull in zip(fast(values), pulls, strict=True)))

    assert_gradients(total, given, gradients(fast, given, pulls), 2e-5, hit_by_each)


@in_every_arrangement
def test_float32_agrees_with_float64_but_where_a_hit_crosses_a_threshold() -> None:
    """A hit at the alpha threshold, at the stop or in a tie is met in one precision and not in the other."""
    given = {name: value.float() for name, value in random_inputs(400, 5000, 3).items()}
    rounded = {name: value.double() for name, value in given.items()}
    crossed = torch.tensor([a != b for a, b in zip(hit_by_each(given), hit_by_each(rounded), strict=True)])
    assert int(crossed.sum()) < 0.01 * len(crossed)
    exact = fast(rounded)
    for name, ours, theirs in zip(OUTPUTS, fast(given), exact, strict=True):
        torch.testing.assert_close(ours[~crossed].double(), theirs[~crossed], rtol=0, atol=1e-4, msg=name)
    pulls = [torch.randn_like(value) for value in exact]
    for pull in pulls:
        pull[crossed] = 0
    ours_by, exact_by = gradients(fast, given, [pull.float() for pull in pulls]), gradients(fast, rounded, pulls)
    for name in FIELDS:
        error = (ours_by[name].double() - exact_by[name]).abs() / exact_by[name].abs().max()
        assert error.max() < 1e-4, name


@in_every_arrangement
@pytest.mark.parametrize("copies", [17, 33, 64])
def test_exactly_coincident_surfels_are_neither_lost_nor_swapped(copies: int) -> None:
    """More equal depths than the buffer holds: the restart must go on after the last (t, number)."""
    one = random_inputs(3, 30, 2)
    given = {
        name: value.repeat_interleave(copies, 0) if name not in ("origin", "direction", "t_min") else value
        for name, value in one.items()
    }
    given["opacity"] = torch.full_like(given["opacity"], 0.02)
    given["sh"] = 0.5 * torch.randn_like(given["sh"])
    for ours, theirs in zip(fast(given, 1e-6), dense(given, 1e-6), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-12)


def small_surfels(count: int) -> Values:
    given = random_inputs(count, 50, 1)
    return given | {"axis_u": 6 * given["axis_u"], "axis_v": 6 * given["axis_v"]}


def splats(given: Values) -> SplatGeometry:
    return SplatGeometry(*(given[name] for name in FIELDS[:5]))


def assert_brute_force_agrees(tree: SurfelBVH, given: Values) -> None:
    hits = trace(
        tree, splats(given), given["sh"], given["features"], given["origin"], given["direction"], given["t_min"]
    )
    for name, theirs in zip(OUTPUTS, dense(given), strict=True):
        torch.testing.assert_close(getattr(hits, name), theirs, rtol=0, atol=1e-12)


def in_kd_order(geometry: SplatGeometry) -> SurfelBVH:
    return SurfelBVH.build(geometry, kd_topology(geometry.centre))


@pytest.mark.parametrize("build", [SurfelBVH.build, in_kd_order])
def test_trees_find_the_hits_of_brute_force_also_after_refitting(build: Callable[[SplatGeometry], SurfelBVH]) -> None:
    given = small_surfels(2000)
    tree = build(splats(given))
    for move in (0.0, 0.02, 0.5):
        given["centre"] = given["centre"] + move * torch.randn(2000, 3, dtype=torch.float64)
        tree.refit(splats(given))
        assert_brute_force_agrees(tree, given)


def test_a_tree_is_built_anew_once_it_is_loose_and_not_before() -> None:
    given = small_surfels(2000)
    tree = SurfelBVH.build(splats(given))
    first = tree.topology
    given["centre"] = given["centre"] + 1e-3 * torch.randn(2000, 3, dtype=torch.float64)
    tree.refit(splats(given))
    assert tree.topology is first
    given["centre"] = given["centre"][torch.randperm(2000)]
    tree.refit(splats(given))
    assert tree.topology is not first
    assert tree.expected_visits < LOOSENED * SurfelBVH.build(splats(given)).expected_visits


def test_the_heuristic_visits_no_more_than_k_d_order() -> None:
    geometry = splats(small_surfels(5000) | {"centre": torch.randn(5000, 3, dtype=torch.float64) ** 3})
    other = in_kd_order(geometry).expected_visits
    assert SurfelBVH.build(geometry).expected_visits < 0.9 * other


def test_surfels_spaced_exponentially_make_no_tree_too_deep_for_the_stack() -> None:
    given = small_surfels(4000)
    step = torch.linspace(-120, 120, 4000, dtype=torch.float64)
    given["centre"] = torch.stack([2**step, 0 * step, 0 * step], -1)
    tree = SurfelBVH.build(splats(given))
    assert len(tree.topology.level_end) <= DEEPEST
    assert sorted(tree.topology.order[tree.topology.order >= 0].tolist()) == list(range(4000))
    assert_brute_force_agrees(tree, given)


def shell(count: int, scale: float, inward: bool) -> SplatGeometry:
    """Surfels that cover a sphere of radius ``scale``, seen from inside or from outside."""
    place = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * place / count
    azimuth = place * 2.399963229728653
    outward = torch.stack([(1 - z * z).sqrt() * azimuth.cos(), (1 - z * z).sqrt() * azimuth.sin(), z], -1)
    tangent = torch.nn.functional.normalize(
        torch.linalg.cross(outward, torch.tensor([0.3, 0.5, 0.8], dtype=torch.float64).expand_as(outward)), dim=-1
    )
    spread = 1.2 * (4 * torch.pi / count) ** 0.5
    fields = (
        scale * outward, tangent / (spread * scale), torch.linalg.cross(outward, tangent) / (spread * scale),
        -outward if inward else outward, torch.full((count,), 0.95, dtype=torch.float64),
    )  # fmt: skip
    return SplatGeometry(*(value.float() for value in fields))


def cast_from_surfels(geometry: SplatGeometry, scale: float) -> Hits:
    direction = torch.nn.functional.normalize(torch.randn(len(geometry), 3), dim=-1)
    below = (direction * geometry.normal).sum(-1, keepdim=True) < 0
    reach = torch.full((len(geometry),), 0.1 * scale)
    return trace(
        SurfelBVH.build(geometry), geometry, torch.zeros(len(geometry), 1, 3), torch.zeros(len(geometry), 0),
        geometry.centre, torch.where(below, -direction, direction), reach,
    )  # fmt: skip


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_closed_room_sees_no_light_and_a_convex_body_sees_all(scale: float) -> None:
    inside = cast_from_surfels(shell(800, scale, inward=True), scale)
    # A ray may leave through its own neighbourhood, within t_min, at grazing angles.
    assert float((inside.transmittance < 0.03).float().mean()) > 0.97
    outside = cast_from_surfels(shell(800, scale, inward=False), scale)
    assert (outside.transmittance == 1).all()


@in_every_arrangement
def test_degenerate_surfels_are_never_met() -> None:
    given = random_inputs(40, 60, 1)
    clean = fast({name: value[:32] if name in FIELDS[:7] else value for name, value in given.items()})
    given["opacity"][32] = 1 / 255 - 1e-9
    given["axis_u"][33] = torch.inf
    given["axis_v"][34] = torch.nan
    given["centre"][35] = torch.nan
    given["axis_u"][36] = 0.0
    given["opacity"][37] = torch.nan
    given["normal"][38] = torch.nan
    given["opacity"][39] = 0.0
    for ours, theirs in zip(fast(given), clean, strict=True):
        assert torch.equal(ours, theirs)


@in_every_arrangement
@pytest.mark.parametrize(("surfels", "rays"), [(0, 5), (5, 0), (1, 1), (9, 3)])
def test_empty_and_tiny_scenes(surfels: int, rays: int) -> None:
    given = random_inputs(surfels, rays, 2)
    found = fast(given)
    if surfels == 0:
        assert (found[1] == 1).all()
        assert (found[0] == 0).all()
    assert found[0].shape == (rays, 3)


@pytest.mark.usefixtures("cpu_arrangement")
@pytest.mark.parametrize("team", [1, 2])
def test_gradients_repeat_bit_for_bit(team: int) -> None:
    use_threads(team)
    given = {name: value.float() for name, value in random_inputs(300, 400, 2).items()}
    pulls = [torch.randn_like(value) for value in fast(given)]
    first, second = gradients(fast, given, pulls), gradients(fast, given, pulls)
    assert all(torch.equal(first[name], second[name]) for name in FIELDS)
