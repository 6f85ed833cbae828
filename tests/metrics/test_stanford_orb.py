"""Stanford-ORB's evaluator, written a second time in NumPy and OpenCV, and the one real example at hand."""

import math

import cv2
import numpy as np
import pytest
import torch

from radiogs_bench.scoring.metrics import stanford_orb as orb
from radiogs_bench.scoring.metrics.conventions import Depth
from radiogs_bench.scoring.metrics.geometry import depth_errors
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.metrics.surface_distance import chamfer, sampled_surface
from radiogs_bench.scoring.metrics.values import PSNR_CAP
from radiogs_core.errors import DataError

ORB = protocol("stanford-orb")


def srgb(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A linear truth with highlights above 1, a prediction of other brightness, and a disc as mask."""
    generator = np.random.default_rng(4)
    rows, columns = np.mgrid[:40, :36]
    mask = (((rows - 20) ** 2 + (columns - 17) ** 2) < 14**2).astype(np.float64)
    truth = generator.random((40, 36, 3)) ** 3 * 3
    image = truth * [0.5, 0.8, 1.3] + 0.05 * generator.standard_normal((40, 36, 3))
    return image, truth, mask


def tensors(*arrays: np.ndarray) -> list[torch.Tensor]:
    return [torch.from_numpy(array if array.ndim == 3 else array[..., None]).double() for array in arrays]


def test_the_mask_is_eroded_as_opencv_erodes() -> None:
    _, _, mask = scene()
    mask[:3, :] = 1  # what lies beyond the frame counts as covered
    expected = cv2.erode((mask * 255).astype(np.uint8), np.ones((5, 5), np.uint8)) > 127
    assert np.array_equal(orb.eroded(tensors(mask)[0]).numpy(), expected)


def test_a_black_truth_is_compared_without_gain() -> None:
    _, truth, mask = scene()
    a, b, m = tensors(np.full_like(truth, 0.1), 0 * truth, mask)
    assert float(orb.psnr_h(a, b, orb.eroded(m))) == pytest.approx(
        -10 * math.log10(0.01 * orb.eroded(m).double().mean())
    )


@pytest.mark.parametrize("relight", [False, True])
def test_both_psnrs_are_the_evaluators(relight: bool) -> None:
    image, truth, mask = scene()
    inside = cv2.erode((mask * 255).astype(np.uint8), np.ones((5, 5), np.uint8)) > 127
    ours, theirs = image * inside[..., None], truth * inside[..., None]
    if relight:
        ours = ours * ((ours * theirs).sum((0, 1)) / (ours**2).sum((0, 1)))
    shown = theirs.clip(0, 1)
    gain = srgb(shown).mean() / shown.mean()
    high = -10 * math.log10(np.mean(((gain * ours).clip(0, 4) - (gain * theirs).clip(0, 4)) ** 2))
    low = -10 * math.log10(np.mean((srgb(ours.clip(0, 1)) - srgb(theirs.clip(0, 1))) ** 2))
    a, b, m = tensors(image, truth, mask)
    found = ORB.score_linear(a, b, m, "relight" if relight else "nvs")
    assert found["psnr_h"].value == pytest.approx(high, abs=1e-5)
    assert found["psnr_l"].value == pytest.approx(low, abs=1e-5)
    assert "psnr_h" in found["psnr"].reason


def test_no_psnr_is_below_the_constant_greys() -> None:
    _, truth, mask = scene()
    inside = orb.eroded(tensors(mask)[0])
    terrible = torch.full((40, 36, 3), 50.0).double()
    floor = np.mean(((0.5 - srgb(truth.clip(0, 1))) * inside.numpy()[..., None]) ** 2)
    assert orb.psnr_l(terrible, tensors(truth)[0], inside) == pytest.approx(-10 * math.log10(floor), abs=1e-5)


def test_relighting_forgives_a_factor_a_channel_and_new_views_do_not() -> None:
    _, truth, mask = scene()
    a, b, m = tensors(truth * [0.5, 2.0, 0.1], truth, mask)
    assert ORB.score_linear(a, b, m, "relight")["psnr_h"].value > 0.99 * PSNR_CAP
    assert ORB.score_linear(a, b, m, "nvs")["psnr_h"].value < 20
    assert ORB.score_albedo(a, b.clamp(0, 1), torch.ones(3), m)["psnr"].value < PSNR_CAP


def test_pixels_outside_the_eroded_mask_never_count() -> None:
    image, truth, mask = scene()
    a, b, m = tensors(image, truth, mask)
    expected = ORB.score_linear(a, b, m, "relight"), ORB.score_albedo(a, b, torch.ones(3), m)
    outside = ~orb.eroded(m)
    a[outside], b[outside] = math.nan, math.inf
    assert (ORB.score_linear(a, b, m, "relight"), ORB.score_albedo(a, b, torch.ones(3), m)) == expected
    for scores in (ORB.score_linear(a, b, 0 * m), ORB.score_albedo(a, b, torch.ones(3), 0 * m)):
        assert {value.reason for value in scores.values()} == {"the mask is empty"}


def test_the_cosine_distance() -> None:
    mask = torch.ones(8, 8, 1)
    target = torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3)
    for degrees in (0, 8, 90, 180):
        radians = math.radians(degrees)
        normal = 3 * torch.tensor([math.sin(radians), 0.0, math.cos(radians)]).expand(8, 8, 3)
        found = ORB.score_normal(normal, target, mask)
        assert found["cosine"].value == pytest.approx(1 - math.cos(radians), abs=3e-6)
        assert found["mae"].value is None
    assert ORB.score_normal(0 * target, target, mask)["cosine"].value == pytest.approx(1)
    assert ORB.score_normal(target, target, 0 * mask)["cosine"].reason == "the mask is empty"


def orb_factor(ours: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """Least squares a channel; a channel whose squares sum to at most 1e-6 counts as ones."""
    given = np.where((ours**2).sum(0) <= 1e-6, 1.0, ours)
    return (theirs * given).sum(0) / (given**2).sum(0)


def test_a_relit_image_that_is_all_but_black_stays_so() -> None:
    """Without the guard a factor of 3e5 would make it perfect."""
    generator = np.random.default_rng(5)
    truth = generator.uniform(0.1, 0.9, (12, 12, 3))
    mask, region = np.ones((12, 12, 1)), np.ones((12, 12), bool)
    for faint, perfect in ((3e-6, False), (3e-3, True)):
        image = faint * truth
        shown = srgb(np.clip(orb_factor(image[region], truth[region]) * image, 0, 1))
        grey = ((0.5 - srgb(truth)) ** 2).mean()
        expected = -10 * math.log10(min(max(((shown - srgb(truth)) ** 2).mean(), 1e-10), grey))
        found = ORB.score_linear(*tensors(image, truth, mask), "relight")["psnr_l"].value
        assert (found > 60) == perfect
        assert found == pytest.approx(expected, abs=0.01) or perfect


def test_a_view_without_depth_counts_as_a_depth_of_one() -> None:
    generator = np.random.default_rng(6)
    truths = generator.uniform(1, 2, (2, 12, 12, 1))
    depths = np.stack([truths[0] / 3, np.zeros((12, 12, 1))])
    given = np.stack([depths[0], np.ones((12, 12, 1))])
    scale = (truths * given).sum() / (given**2).sum()
    expected = ((scale * given - truths) ** 2).mean((1, 2, 3))
    sides = [[torch.from_numpy(each) for each in side] for side in (depths, truths)]
    found = ORB.score_depth(*sides, [torch.ones(12, 12, 1)] * 2)
    assert [scores["simse"].value for scores in found] == pytest.approx(expected.tolist(), rel=1e-6)


def test_depth_has_one_scale_for_all_views_or_one_a_view() -> None:
    truths = [1 + torch.rand(10, 10, 1).double() for _ in range(2)]
    masks = [torch.zeros(10, 10, 1) for _ in range(2)]
    for mask in masks:
        mask[2:7, 2:7] = 1
    depths = [truths[0] / 3, truths[1] / 5]
    for depth in depths:
        depth[0] = math.nan
    assert depth_errors(depths, truths, masks, Depth("each view")) == pytest.approx([0, 0], abs=1e-12)
    inside = [mask[..., 0] > 0.5 for mask in masks]
    ours, theirs = (torch.cat([side[view][inside[view]] for view in range(2)]) for side in (depths, truths))
    scale = float((ours * theirs).sum() / (ours**2).sum())
    expected = [float(((scale * depths[v] - truths[v])[inside[v]] ** 2).sum()) / 100 for v in range(2)]
    assert depth_errors(depths, truths, masks) == pytest.approx(expected)
    found = depth_errors(depths, truths, [masks[0], 0 * masks[1]])
    assert found[0] == pytest.approx(0, abs=1e-12)
    assert math.isnan(found[1])


SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_shifted_square_is_as_far_as_its_shift() -> None:
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 101), np.linspace(0, 1, 101)), -1).reshape(-1, 2)
    truth = np.concatenate([grid, np.full((len(grid), 1), 0.3)], 1)
    assert chamfer(SQUARE, FACES, truth) == pytest.approx(0.09, abs=1e-4)
    assert chamfer(SQUARE, FACES, truth - [0, 0, 0.3]) < 1e-4


def test_both_directions_count_half() -> None:
    """One far true point among ten: its mean squared distance, halved, and nothing of the way back."""
    truth = np.concatenate([np.tile([[0.5, 0.5, 0.0]], (9, 1)), [[0.5, 0.5, 10.0]]])
    ours = np.array([[0.5, 0.5, 0], [0.5, 0.5, 1e-9], [0.5, 0.5 + 1e-9, 0]])
    assert chamfer(ours, np.array([[0, 1, 2]]), truth, samples=10) == pytest.approx(100 / 10 / 2)


def test_a_surface_is_sampled_by_area() -> None:
    """Two triangles whose areas are as 9 to 1."""
    vertices = np.array([[0.0, 0, 0], [9, 0, 0], [0, 2, 0], [20, 0, 0], [21, 0, 0], [20, 2, 0]])
    points = sampled_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), 20_000, np.random.default_rng(0))
    assert np.mean(points[:, 0] > 15) == pytest.approx(0.1, abs=0.01)
    assert points[points[:, 0] < 15].mean(0) == pytest.approx([3, 2 / 3, 0], abs=0.05)


def test_a_shape_without_surface_is_an_error() -> None:
    with pytest.raises(DataError, match="no surface"):
        chamfer(SQUARE * 0, FACES, SQUARE)
    with pytest.raises(DataError, match="no vertices"):
        chamfer(SQUARE, FACES, SQUARE[:0])


def read(path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return image[..., ::-1].astype(np.float64) / 255 if image.ndim == 3 else image.astype(np.float64) / 255


def linear(display: np.ndarray) -> np.ndarray:
    return np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)


def test_the_real_examples_view_and_albedo(shared_data) -> None:
    """31.93 dB between its optimised and reference images, 39.62 dB of albedo, scale (0.239, 0.273, 0.387)."""
    folder = shared_data / "stanford_orb_example"
    predictions = folder / "test" / "mymethod" / "teapot_scene001"
    capture = folder / "data" / "teapot_scene001"
    optimised, reference = tensors(read(predictions / "val_000000_opt.png"), read(predictions / "val_000000_ref.png"))
    scores = protocol("default").score_image(optimised.float(), reference.float())
    assert scores["psnr"].value == pytest.approx(31.926, abs=5e-4)
    by_channel = protocol("irgs").score_image(optimised.float(), reference.float(), torch.ones(512, 512, 1))
    assert by_channel["psnr"].value == pytest.approx(31.952, abs=5e-4)

    mask = cv2.resize(read(capture / "test_mask" / "0000.png"), (512, 512), interpolation=cv2.INTER_AREA)
    albedo = cv2.resize(read(capture / "albedo_maps" / "0000.png"), (512, 512), interpolation=cv2.INTER_AREA)
    image, target, covered = tensors(linear(read(predictions / "val_000000_kd.png")), linear(albedo), mask)
    inside = orb.eroded(covered)
    assert float(inside.double().mean()) == pytest.approx(0.0921, abs=5e-5)
    scale = orb.least_squares(image[inside], target[inside])
    assert scale.tolist() == pytest.approx([0.239, 0.273, 0.387], abs=6e-4)
    assert ORB.score_albedo(image, target, torch.ones(3), covered)["psnr"].value == pytest.approx(39.62, abs=6e-3)
