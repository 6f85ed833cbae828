"""Kernels of images (K7 to K9, K12, K15) against dense float64 ones and their gradients, and SSIM of skimage."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from radiogs_core.kernels.image.blocks import COLUMNS
from radiogs_core.kernels.image.depth_map import one_sided_normals, points_of
from radiogs_core.kernels.image.display import displayed
from radiogs_core.kernels.image.edges import edge_allowance, edge_aware_smoothness
from radiogs_core.kernels.image.similarity import compared
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.colour import LINEAR_KNEE
from reference import images as dense
from reference.differences import assert_same_with_gradients

in_every_arrangement = pytest.mark.usefixtures("arrangement")

SIZES = [(1, 1), (1, 7), (7, 1), (2, 2), (13, 11), (9, COLUMNS), (5, 2 * COLUMNS + 3)]
"""Smaller than a window, within a block, a whole one, and some blocks with a rest."""


def image(height: int, width: int, channels: int = 3, highest: float = 1.0) -> torch.Tensor:
    return highest * torch.rand(height, width, channels, dtype=torch.float64)


@in_every_arrangement
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_images_are_compared_as_by_the_dense_sums(height: int, width: int) -> None:
    images = torch.stack([image(height, width, highest=1.3), image(height, width), image(height, width)])
    target = image(height, width, highest=1.2).clamp(max=1)
    assert_same_with_gradients(
        lambda images: compared(images, target), lambda images: dense.compared(images, target.cpu()), images
    )


def test_ssim_is_skimages_on_the_zero_padded_image() -> None:
    given, target = image(20, 24), image(20, 24)
    padded = [np.pad(side.numpy(), ((5, 5), (5, 5), (0, 0))) for side in (given, target)]
    _, expected = structural_similarity(
        *padded,
        channel_axis=2,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    assert float(compared(given[None], target)[0, 1]) == pytest.approx(expected[5:-5, 5:-5].mean(), abs=1e-9)


def test_values_above_a_saturated_target_have_no_error_and_no_gradient() -> None:
    target = image(12, 12)
    target[4:8, 4:8] = 1
    given = target.clone()
    given[4:8, 4:8] = 2.5
    given.requires_grad_()
    found = compared(given[None], target)[0]
    torch.testing.assert_close(found, found.new_tensor([0.0, 1.0, 0.0]))
    (found[0] - found[1] + found[2]).backward()
    assert given.grad is not None
    assert not bool(given.grad[4:8, 4:8].any())


def test_slopes_of_float32_are_as_good_as_its_digits() -> None:
    given, target = image(40, 50), image(40, 50)
    exact = compared(given[None], target)
    torch.testing.assert_close(compared(given[None].float(), target.float()).double(), exact, rtol=1e-5, atol=0)


def test_what_is_no_number_reaches_the_sums() -> None:
    given = image(8, 8)
    given[3, 3, 1] = torch.nan
    assert bool(compared(given[None], image(8, 8)).isnan().all())
    assert bool(edge_aware_smoothness(given, edge_allowance(image(8, 8))).isnan())


@in_every_arrangement
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_edge_weights_agree_with_the_dense_slopes(height: int, width: int, masked: bool) -> None:
    guide = image(height, width)
    mask = (2.5 * torch.rand(height, width, dtype=torch.float64)).clamp(max=1) if masked else None
    expected = dense.edge_allowance(guide.cpu(), 10.0, None if mask is None else mask.cpu())
    torch.testing.assert_close(edge_allowance(guide, 10.0, mask).cpu(), expected, rtol=1e-12, atol=1e-14)


@in_every_arrangement
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("height", "width"), SIZES)
def test_smoothness_agrees_with_the_dense_slopes(height: int, width: int, channels: int) -> None:
    allowance = torch.rand(2, height, width, 3, dtype=torch.float64)
    assert_same_with_gradients(
        lambda data: edge_aware_smoothness(data, allowance),
        lambda data: dense.edge_aware_smoothness(data, allowance.cpu()),
        image(height, width, channels),
    )


@in_every_arrangement
@pytest.mark.parametrize("share", [0.5, 0.9, 1.0])
@pytest.mark.parametrize(("height", "width"), [size for size in SIZES if size[1] < COLUMNS])
def test_one_sided_normals_agree_with_loops_over_pixels(height: int, width: int, share: float) -> None:
    depth, solid = 2 + torch.rand(height, width, dtype=torch.float64), torch.rand(height, width) < share
    toward = torch.tensor([0.3, -0.2, 0.1], dtype=torch.float64)
    rays = torch.cat([image(height, width, 2), torch.ones(height, width, 1, dtype=torch.float64)], -1)
    assert_same_with_gradients(
        lambda points: one_sided_normals(points, depth, solid, toward),
        lambda points: dense.one_sided_normals(points, depth.cpu(), solid.cpu(), toward.cpu()),
        toward + rays * depth[..., None],
    )


def test_coinciding_points_have_neither_normal_nor_gradient() -> None:
    points = torch.zeros(5, 5, 3, requires_grad=True)
    found = one_sided_normals(points, torch.ones(5, 5), torch.ones(5, 5, dtype=torch.bool), torch.ones(3))
    found.sum().backward()
    assert not bool(found.any())
    assert points.grad is not None
    assert not bool(points.grad.any())


@pytest.mark.parametrize("broken", [torch.nan, torch.inf, 0.0])
def test_a_depth_that_is_no_number_takes_its_own_normal_alone(broken: float) -> None:
    depth = torch.full((9, 9), 2.0, dtype=torch.float64)
    rays = torch.stack([*torch.meshgrid(torch.linspace(0, 1, 9), torch.linspace(0, 1, 9), indexing="xy")], -1).double()
    points = torch.cat([rays, torch.ones(9, 9, 1, dtype=torch.float64)], -1) * depth[..., None]
    depth[4, 4] = broken
    found = one_sided_normals(points, depth, torch.ones(9, 9, dtype=torch.bool), torch.zeros(3, dtype=torch.float64))
    others = torch.ones(9, 9, dtype=torch.bool)
    others[4, 4] = False
    assert bool((found[others].norm(dim=-1) - 1).abs().max() < 1e-12)


def test_results_do_not_depend_on_the_number_of_threads() -> None:
    given, target, allowance = image(30, 150), image(30, 150), torch.rand(2, 30, 150, 3, dtype=torch.float64)
    found = []
    for threads in (1, 2, 3):
        use_threads(threads)
        leaf = given.clone().requires_grad_()
        shown = displayed(leaf[None], allowance[0, ..., 0])
        (compared(shown, target).sum() + edge_aware_smoothness(leaf, allowance)).backward()
        assert leaf.grad is not None
        found.append(leaf.grad)
    assert all(torch.equal(each, found[0]) for each in found)


@in_every_arrangement
@pytest.mark.parametrize("background", [0.0, 1.0])
@pytest.mark.parametrize("straight", [True, False])
@pytest.mark.parametrize(("height", "width"), [(1, 1), (4, 8), (13, 11)])
def test_images_are_encoded_as_by_the_dense_curve(height: int, width: int, straight: bool, background: float) -> None:
    """Uncovered pixels, negative radiance, values below the curve's knee, and images brighter than white."""
    alpha = torch.rand(height, width, dtype=torch.float64)
    blended = torch.stack(
        [image(height, width, highest=2.0), image(height, width, highest=0.004), -image(height, width)]
    )
    if height > 1:
        alpha[:3], blended[:, :3] = 0, 0
    assert_same_with_gradients(
        lambda blended, alpha: displayed(blended, alpha, straight, background),
        lambda blended, alpha: dense.displayed(blended, alpha, straight, background),
        blended,
        alpha,
    )


def test_no_image_has_no_display() -> None:
    assert displayed(torch.zeros(0, 4, 5, 3), torch.ones(4, 5)).shape == (0, 4, 5, 3)
    assert displayed(torch.zeros(2, 0, 5, 3), torch.ones(0, 5)).shape == (2, 0, 5, 3)


@in_every_arrangement
@pytest.mark.parametrize(("height", "width"), [(1, 1), (4, 7), (9, 5)])
def test_points_lie_at_their_depths_along_the_pixels_rays(height: int, width: int) -> None:
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64)).Q
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3], pose[:3, 3] = turn * turn.det(), torch.tensor([1.0, -2.0, 0.5])
    camera = Camera(pose, 11.0, 13.0, 0.4 * width, 0.7 * height, width, height)
    depth = image(height, width, 1, highest=5.0)[..., 0]
    assert_same_with_gradients(
        lambda depth: points_of(camera, depth),
        lambda depth: camera.centre + camera.ray_directions() * depth[..., None],
        depth,
    )


def encoded(linear: np.ndarray) -> np.ndarray:
    given = torch.from_numpy(linear).reshape(1, -1, 1, 3)
    return displayed(given, torch.ones(given.shape[1:3], dtype=given.dtype), straight=False).numpy().reshape(-1)


@pytest.mark.parametrize(("dtype", "highest", "tolerance"), [("f4", 1e38, 3e-7), ("f8", 1e300, 4e-15)])
def test_the_curve_is_good_to_the_last_digits_of_its_type(dtype: str, highest: float, tolerance: float) -> None:
    random, knee = np.random.default_rng(0), LINEAR_KNEE
    powers = 2.0 ** np.arange(-8, 127)
    linear = np.concatenate(
        [
            np.exp(random.uniform(np.log(knee), np.log(highest), 100_000)),
            random.uniform(knee, 2, 100_000),
            *(powers * (1 + step) for step in (-1e-7, 0, 1e-7)),
            *(powers * (np.sqrt(0.5) + step) for step in (-1e-7, 1e-7)),
        ]
    ).astype(dtype)
    linear = linear[linear > knee]
    linear = linear[: len(linear) // 3 * 3]
    # The exponent 1 / 2.4 = 5 / 12 as roots, for its own rounding is 1e-14 of the largest numbers.
    expected = 1.055 * np.sqrt(np.sqrt(np.cbrt(linear.astype("f8")))) ** 5 - 0.055
    assert np.abs(encoded(linear) / expected - 1).max() < tolerance


@in_every_arrangement
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_curve_keeps_what_is_no_number_and_the_line_what_is_dark(dtype: torch.dtype) -> None:
    tiny = torch.finfo(dtype).tiny
    linear = torch.tensor([0.0, -0.0, -0.5, -1e30, tiny, -tiny, 0.003, torch.inf, -torch.inf], dtype=dtype)
    found = displayed(linear.view(1, 3, 1, 3), linear.new_ones(3, 1), straight=False).flatten()
    torch.testing.assert_close(found, 12.92 * linear, rtol=1e-7, atol=0)
    whole = torch.full((1, 20, 2, 3), 0.25, dtype=dtype)
    broken = whole.clone()
    broken[0, 17, 1, 2] = torch.nan
    coverage = linear.new_full((20, 2), 0.5)
    others = broken == broken
    shown = displayed(broken, coverage)
    assert torch.equal(shown.isnan(), ~others)
    assert torch.equal(shown[others], displayed(whole, coverage)[others])


@in_every_arrangement
def test_uncovered_pixels_show_the_background_and_get_no_gradient() -> None:
    blended = torch.full((1, 3, 7, 3), torch.nan, dtype=torch.float64).requires_grad_()
    alpha = torch.zeros(3, 7, dtype=torch.float64).requires_grad_()
    shown = displayed(blended, alpha, background=0.7)
    assert bool((shown == 0.7).all())
    shown.sum().backward()
    assert blended.grad is not None
    assert not bool(blended.grad.any())
    torch.testing.assert_close(alpha.grad, torch.full_like(alpha, 3 * -0.7).detach())
