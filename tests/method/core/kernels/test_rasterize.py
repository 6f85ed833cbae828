"""K1 against a dense float64 implementation, finite differences, and what must not change the image."""

from collections.abc import Callable
from itertools import pairwise

import pytest
import torch

from ptx.launch import launched_from_ptx, ptx_of
from ptx.machine import Account
from radiogs_core.instruments import recording
from radiogs_core.kernels.rasterize.binning import TILE, Bounds, counted_lists, sorted_lists
from radiogs_core.kernels.rasterize.projection import project
from radiogs_core.kernels.rasterize.rasterize import blend_kernels, blend_together, rasterize
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.scene.camera import Camera
from reference.differences import Values, assert_gradients, assert_same_slopes, gradients_of
from reference.rasterize import rasterize as dense_rasterize
from scenes import look_at

FIELDS = ("centre", "axis_u", "axis_v", "normal", "opacity", "features")

in_every_arrangement = pytest.mark.usefixtures("arrangement")
UNIT = 3.0
Shown = tuple[torch.Tensor, ...]


def camera(width: int = 17, height: int = 13, distance: float = 4.0) -> Camera:
    looking = look_at(torch.tensor([distance, 0.3, 0.5]), torch.zeros(3), 16, 20.0).to(dtype=torch.float64)
    return Camera(looking.camera_to_world, 20.0, 19.0, width / 2 + 0.3, height / 2, width, height)


def random_surfels(count: int, channels: int = 4, spread: float = 0.7) -> Values:
    frame = torch.linalg.qr(torch.randn(count, 3, 3, dtype=torch.float64)).Q
    scale = 0.1 + 0.3 * torch.rand(count, 2, dtype=torch.float64)
    return {
        "centre": spread * torch.randn(count, 3, dtype=torch.float64),
        "axis_u": frame[..., 0] / scale[:, :1],
        "axis_v": frame[..., 1] / scale[:, 1:],
        "normal": frame[..., 2].contiguous(),
        "opacity": 0.05 + 0.95 * torch.rand(count, dtype=torch.float64),
        "features": torch.rand(count, channels, dtype=torch.float64),
    }


def fast(given: Values, view: Camera) -> Shown:
    raster = rasterize(view, SplatGeometry(*(given[name] for name in FIELDS[:5])), given["features"], UNIT)
    return raster.features, raster.alpha, raster.depth, raster.distortion


def dense(given: Values, view: Camera) -> Shown:
    pixels = view.ray_directions().reshape(-1, 3)
    flat = dense_rasterize(view.axes, view.centre, pixels, *given.values(), UNIT)
    return tuple(value.unflatten(0, (view.height, view.width)) for value in flat)


def gradients(function: Callable[..., Shown], given: Values, view: Camera, pulls: list[torch.Tensor]) -> Values:
    return gradients_of(lambda leaves: function(leaves, view), given, pulls, FIELDS)


def assert_same(found: Shown, expected: Shown, tolerance: float = 1e-11) -> None:
    for ours, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=0, atol=tolerance)


@pytest.mark.slow
@in_every_arrangement
def test_float64_equals_the_dense_image_and_its_gradients() -> None:
    given, view = random_surfels(40), camera()
    found, expected = fast(given, view), dense(given, view)
    assert_same(found, expected)
    assert float(found[1].max()) > 0.9
    pulls = [torch.randn_like(value) for value in found]
    assert_same_slopes(gradients(fast, given, view, pulls), gradients(dense, given, view, pulls))


@pytest.mark.slow
@in_every_arrangement
def test_detached_channels_give_gradient_to_their_features_alone() -> None:
    given, view = random_surfels(40), camera()
    kept = torch.tensor([1.0, 0.0, 1.0, 0.0])

    def detached(leaves: Values, view: Camera) -> Shown:
        geometry = SplatGeometry(*(leaves[name] for name in FIELDS[:5]))
        raster = blend_together(project(view, geometry), leaves["features"].split(1, -1), UNIT, (1, 3))
        return torch.cat(raster.images, -1), raster.alpha, raster.depth, raster.distortion

    images = fast(given, view)
    assert_same(detached(given, view), images, 0.0)
    pulls = [torch.randn_like(value) for value in images]
    found, whole = gradients(detached, given, view, pulls), gradients(dense, given, view, pulls)
    of_kept = gradients(dense, given, view, [pulls[0] * kept, *pulls[1:]])
    assert_same_slopes(found, {**of_kept, "features": whole["features"]})
    assert (of_kept["centre"] - whole["centre"]).abs().max() > 0.01 * whole["centre"].abs().max()


@in_every_arrangement
def test_the_mean_depth_and_its_gradients_are_those_of_depth_over_coverage() -> None:
    given, view = random_surfels(8), camera()

    def mean(leaves: Values, view: Camera) -> Shown:
        geometry = SplatGeometry(*(leaves[name] for name in FIELDS[:5]))
        return (rasterize(view, geometry, leaves["features"], UNIT).mean_depth,)

    def quotient(leaves: Values, view: Camera) -> Shown:
        _, alpha, depth, _ = dense(leaves, view)
        return (torch.where(alpha > 0, depth / torch.where(alpha > 0, alpha, 1.0), 0.0) + 0 * leaves["features"].sum(),)

    found, expected = mean(given, view), quotient(given, view)
    assert_same(found, expected)
    assert 0.1 < float((found[0] == 0).double().mean()) < 0.9
    pulls = [torch.randn_like(found[0])]
    ours, theirs = gradients(mean, given, view, pulls), gradients(quotient, given, view, pulls)
    for name in FIELDS:
        assert (ours[name] - theirs[name]).abs().max() <= 1e-9 * theirs[name].abs().max(), name


def test_gradients_equal_central_differences_in_random_directions() -> None:
    given, view = random_surfels(12), camera(9, 7)
    pulls = [torch.randn_like(value) for value in fast(given, view)]

    def total(values: Values) -> float:
        return float(sum((out * pull).sum() for out, pull in zip(fast(values, view), pulls, strict=True)))

    def pairs(values: Values) -> int:
        with recording() as instruments:
            fast(values, view)
        return instruments.work["blended_pairs"]

    assert_gradients(total, given, gradients(fast, given, view, pulls), 2e-5, pairs)


@in_every_arrangement
def test_float32_agrees_with_float64_on_the_rounded_inputs() -> None:
    given, view = {name: value.float() for name, value in random_surfels(300).items()}, camera(33, 21)
    rounded = {name: value.double() for name, value in given.items()}
    exact = fast(rounded, view)
    for ours, theirs in zip(fast(given, view), exact, strict=True):
        assert ((ours.double() - theirs).abs() < 1e-4).double().mean() > 0.99
    pulls = [torch.randn_like(value) for value in exact]
    ours_by = gradients(fast, given, view, [pull.float() for pull in pulls])
    exact_by = gradients(fast, rounded, view, pulls)
    for name in FIELDS:
        error = (ours_by[name].double() - exact_by[name]).abs() / exact_by[name].abs().max()
        assert (error < 1e-4).double().mean() > 0.99, name


@in_every_arrangement
@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 17), (17, 1), (15, 33), (4096, 1)])
def test_any_image_shape_is_covered(width: int, height: int) -> None:
    given, view = random_surfels(20, channels=1), camera(width, height)
    assert_same(fast(given, view), dense(given, view))


def test_surfels_that_cross_the_cameras_plane_are_neither_lost_nor_ghosts() -> None:
    given, view = random_surfels(40, spread=0.5), camera(distance=0.6)
    depths = view.depth_of(given["centre"])
    assert float(depths.min()) < 0 < float(depths.max())
    assert_same(fast(given, view), dense(given, view), 1e-9)


@pytest.mark.parametrize("tiles", [1, 2, 3])
def test_a_surfel_across_the_cameras_plane_is_listed_in_every_tile_and_in_no_other(tiles: int) -> None:
    view = camera(tiles * TILE, TILE)
    across, along = view.axes[:, 0].double()[None], view.axes[:, 2].double()[None]
    normal = torch.linalg.cross(across, along)
    # Seen at a grazing angle from just above its plane; it reaches as far behind the camera as before it.
    centre = view.centre.double() - 0.01 * normal + 0.01 * along
    surfel = SplatGeometry(centre, across, along, normal, torch.tensor([0.9], dtype=torch.float64))
    lists = project(view, surfel).lists
    assert lists.members.tolist() == [0] * tiles
    assert lists.starts.tolist() == list(range(tiles + 1))


@in_every_arrangement
def test_degenerate_surfels_change_no_bit() -> None:
    given, view = random_surfels(40), camera()
    clean = fast({name: value[:32] for name, value in given.items()}, view)
    given["opacity"][32] = 1 / 255 - 1e-9
    given["axis_u"][33] = torch.inf
    given["axis_v"][34] = torch.nan
    given["centre"][35] = torch.nan
    given["axis_u"][36] = 0.0
    given["opacity"][37] = torch.nan
    given["normal"][38] = torch.nan
    given["centre"][39] = 1000.0 * view.centre
    for ours, theirs in zip(fast(given, view), clean, strict=True):
        assert torch.equal(ours, theirs)


def test_order_of_the_surfels_does_not_matter() -> None:
    given, view = random_surfels(50), camera()
    shuffle = torch.randperm(50)
    assert_same(fast({name: value[shuffle] for name, value in given.items()}, view), fast(given, view), 1e-12)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_scaling_the_world_changes_only_depth(scale: float) -> None:
    given, view = random_surfels(50), camera()
    larger = given | {
        "centre": scale * given["centre"],
        "axis_u": given["axis_u"] / scale,
        "axis_v": given["axis_v"] / scale,
    }
    matrix = view.camera_to_world.clone()
    matrix[:3, 3] *= scale
    moved = Camera(matrix, view.fx, view.fy, view.cx, view.cy, view.width, view.height)
    features, alpha, depth, _ = fast(larger, moved)
    expected = fast(given, view)
    assert_same((features, alpha, depth / scale), expected[:3], 1e-10)


def _in_float64(count: int) -> torch.Tensor:
    return torch.arange(count, dtype=torch.float64)


SPREADS = {
    "even": lambda count: _in_float64(count) - 7,
    "some close together": lambda count: 1e6 + 1e-9 * _in_float64(count) + (_in_float64(count) // 8),
    "all but one close together": lambda count: (
        torch.where(_in_float64(count) < count - 1, 1.0, 1e30) * (1 + 1e-12 * (_in_float64(count) - 20))
    ),
    "around zero": lambda count: torch.where(_in_float64(count) < count - 1, 1e-20 * (_in_float64(count) - 20), 1e30),
}


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("count", [0, 60])
def test_both_ways_of_listing_give_each_tile_its_surfels_in_order(count: int, spread: str) -> None:
    view = camera(23, 14)
    across, down = 6, 4
    first = torch.stack([torch.randint(across, (count,)), torch.randint(down, (count,))], -1)
    last = torch.minimum(first + torch.randint(3, (count, 2)), torch.tensor([across - 1, down - 1]))
    tiles, order = torch.cat([first, last], -1).int(), torch.randperm(count)
    depth = torch.empty(count, dtype=torch.float64).scatter_(0, order, SPREADS[spread](count))
    expected = [
        [int(surfel) for surfel in order if (first[surfel] <= place).all() and (place <= last[surfel]).all()]
        for place in (torch.tensor([tile % across, tile // across]) for tile in range(across * down))
    ]
    everywhere = torch.ones(count, dtype=torch.bool)
    for gather in (counted_lists, sorted_lists):
        lists = gather(view, Bounds(tiles, depth, everywhere.to(torch.uint8), everywhere))
        found = [lists.members[begin:end].tolist() for begin, end in pairwise(lists.starts.tolist())]
        assert found == expected


@in_every_arrangement
def test_an_empty_scene_is_the_background_and_takes_gradients() -> None:
    given, view = {name: value[:0] for name, value in random_surfels(3).items()}, camera()
    found = fast(given, view)
    assert all((value == 0).all() for value in found)
    slopes = gradients(fast, given, view, [torch.ones_like(value) for value in found])
    assert slopes["centre"].shape == (0, 3)


@in_every_arrangement
@pytest.mark.parametrize("team", [1, 2])
def test_gradients_repeat_bit_for_bit(team: int) -> None:
    use_threads(team)
    given, view = {name: value.float() for name, value in random_surfels(200).items()}, camera(40, 40)
    pulls = [torch.randn_like(value) for value in fast(given, view)]
    first, second = gradients(fast, given, view, pulls), gradients(fast, given, view, pulls)
    assert all(torch.equal(first[name], second[name]) for name in FIELDS)


@pytest.mark.slow
def test_gradients_from_ptx_need_no_atomics_and_any_order_of_threads_gives_the_same_bits() -> None:
    """Five of the nine tiles reach beyond the image, and half of the last warp has none."""
    given, view = random_surfels(40, channels=9), camera(11, 11)
    pulls = [torch.randn_like(value) for value in dense(given, view)]
    found, accounts = [], [Account(), Account()]
    for seed, account in enumerate(accounts):
        with launched_from_ptx(account, seed):
            found.append(gradients(fast, given, view, pulls))
    assert_same_slopes(found[0], gradients(dense, given, view, pulls))
    assert all(torch.equal(found[0][name], found[1][name]) for name in FIELDS)
    for account in accounts:
        assert account.kernels["rasterize_backward float64"] == account.kernels["rasterize_gather float64"] == 1
        assert account.atomics.total() == account.found.total() == 0, account.reports


def test_rows_that_lanes_hand_over_lie_in_registers_of_a_card() -> None:
    assert "__local_depot" not in ptx_of(blend_kernels(torch.float64, 13, on_cuda=True).backward)


def test_surfels_whose_centres_lie_behind_the_camera_come_first_and_in_the_order_of_their_depths() -> None:
    """Discs of a floor below the camera, which reach from behind it to before it."""
    view, depths = camera(), torch.tensor([0.5, -0.3, 0.2, -0.9, -0.1, 0.2], dtype=torch.float64)
    right, down, forward = view.axes.T.expand(len(depths), 3, 3).unbind(1)
    geometry = SplatGeometry(
        view.centre + depths[:, None] * forward + down, right / 3, forward / 3, -down, torch.full_like(depths, 0.9)
    )
    lists = project(view, geometry).lists
    assert lists.touched.all()
    tiles = [lists.members[begin:end].tolist() for begin, end in pairwise(lists.starts.tolist())]
    in_order = depths.argsort(stable=True).tolist()
    assert max(tiles, key=len) == in_order
    assert all(tile == [surfel for surfel in in_order if surfel in tile] for tile in tiles)
