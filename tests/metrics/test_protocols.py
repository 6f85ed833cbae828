"""Values of each named protocol on known images; stored results keep the default protocol."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from radiogs_bench.scoring.metrics.conventions import Psnr
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.metrics.psnr import psnr
from radiogs_bench.scoring.metrics.values import PSNR_CAP, Value

ONES = torch.ones(3)
DESCENDANTS = ("radiogs", "irgs", "r3dg", "gs-ir", "gi-gs", "svg-ir")


def disc(size: int = 96) -> torch.Tensor:
    """Coverage of a disc with an anti-aliased rim."""
    rows, columns = torch.meshgrid(*[torch.arange(size) + 0.5 - size / 2] * 2, indexing="ij")
    return (0.4 * size - torch.hypot(rows, columns) + 0.5).clamp(0, 1)[..., None]


def bytes_of(image: torch.Tensor) -> torch.Tensor:
    return (image * 255).round() / 255


def test_the_default_has_not_moved() -> None:
    """Results are compared across versions under this name: whoever changes a field needs a new name."""
    assert protocol("default").describe() == {
        "name": "default",
        "title": "default",
        "version": 1,
        "nvs": (picture := {
            "background": "black", "prediction": "rendered", "target": "composited", "clipped": True,
            "prediction_bits": "float", "target_bits": "float",
        }),
        "relight": picture,
        "psnr": {"channels": "joint", "albedo_views": "mean"},
        "ssim": {
            "window": 11, "taps": "gaussian", "padding": "valid", "covariance": "population", "bounded": False,
            "data_range": 1.0,
        },
        "lpips": [{"net": "alex", "input": "[-1, 1]"}],
        "normal": {
            "measure": "angle", "region": "mask", "blended_by": "own coverage", "lengths": "unit",
            "prediction_bits": "float",
        },
        "albedo": {
            "align": "median", "fitted_to": "all views", "pixels": "solid", "fitted_target": "composited",
            "largest": None, "scaled": "everywhere", "psnr_space": "linear", "structure_space": "linear",
            "picture": picture, "relights": True, "difference": "CIEDE2000",
        },
        "roughness": {"region": "mask", "target": "composited"},
        "indirect": {"quantity": "outgoing", "picture": picture},
        "depth": None,
        "depth_offset": {"covered": 0.5},
        "environment": {"scale": "factor a channel"},
        "images": "display sRGB, peak 1",
        "psnr_cap": "100 dB",
        "mean": "over lights, then over views",
    }  # fmt: skip


def test_every_protocol_is_itself_and_can_be_recorded() -> None:
    described = [protocol(name).describe() for name in PROTOCOLS]
    assert [json.loads(json.dumps(words, allow_nan=False)) for words in described] == described
    bare = [json.dumps(words | {"name": "", "title": ""}) for words in described]
    assert len(set(bare)) == len(bare)
    assert set(PROTOCOLS) == {"default", "stanford-orb", "tensoir", *DESCENDANTS}


@pytest.mark.parametrize("name", ["default", "radiogs", "irgs", "r3dg", "svg-ir", "tensoir"])
def test_a_perfect_opaque_render_is_perfect(name: str) -> None:
    image, ones = bytes_of(torch.rand(32, 32, 3)), torch.ones(32, 32, 1)
    for task in ("nvs", "relight"):
        found = protocol(name).score_image(image, image, ones, ones, task)
        assert found["psnr"].value == PSNR_CAP
        assert found["ssim"].value == pytest.approx(1)


@pytest.mark.parametrize("name", DESCENDANTS)
def test_the_splatting_codes_average_three_psnrs(name: str) -> None:
    target, ones = bytes_of(torch.rand(32, 32, 3)), torch.ones(32, 32, 1)
    image = (target + torch.tensor([0.1, 0.01, 0.01]) * torch.randn_like(target)).clamp(0, 1)
    found = protocol(name).score_image(image, target, ones, ones)["psnr"].value
    assert found == pytest.approx(psnr(image, target, Psnr("mean of channels")), abs=1e-9)
    assert found > protocol("default").score_image(image, target)["psnr"].value + 5


def test_a_perfect_relit_disc_tops_out_where_coverage_is_applied_twice() -> None:
    """IRGS multiplies a composited render by the coverage once more: its rim carries a^2 against a."""
    alpha = disc()
    target = 0.8 * alpha * ONES
    found = protocol("irgs").score_image(target, target, alpha, alpha, "relight")["psnr"].value
    rim = 0.8 * (alpha - alpha**2).double()
    assert found == pytest.approx(-10 * math.log10(float(rim.square().mean())), abs=1e-3)
    assert 25 < found < 45
    assert protocol("irgs").score_image(target, target, alpha, alpha, "nvs")["psnr"].value > found + 10
    # The rule that the truth is straight where nothing is multiplied into it does the same to GS-IR's rim.
    assert protocol("gs-ir").score_image(target, target, alpha, alpha, "relight")["psnr"].value < 45


def test_the_truth_is_cut_to_bytes_by_the_2dgs_reader() -> None:
    """A truth halfway between two levels is read as the lower: half a level for a perfect render."""
    target = ((torch.arange(32 * 32 * 3) % 200).view(32, 32, 3) + 0.5) / 255
    found = protocol("irgs").score_image(target, target)["psnr"].value
    assert found == pytest.approx(-20 * math.log10(0.5 / 255), abs=1e-3)


def test_tensoir_composites_on_white_and_relights_with_a_hard_mask() -> None:
    alpha = disc()
    target = 0.3 * alpha * ONES
    rules = protocol("tensoir")
    assert rules.score_image(target, target, alpha, alpha)["psnr"].value == PSNR_CAP
    found = rules.score_image(target, target, alpha, alpha, "relight")["psnr"].value
    hard = torch.where(alpha > 0.5, 0.3, 1.0)
    error = (hard - (0.3 * alpha + 1 - alpha)).double().square().mean()
    assert found == pytest.approx(-10 * math.log10(float(error)), abs=1e-3)
    missing = rules.score_image(0 * target, target, alpha, 0 * alpha)["psnr"].value
    assert missing == pytest.approx(-10 * math.log10(float((0.7 * alpha).double().square().mean())), abs=1e-3)


def test_tensoir_pools_the_error_of_albedo_over_views() -> None:
    """Errors of 1e-2, 1e-3 and 1e-4: 30 dB as a mean of PSNRs, 24.32 dB pooled."""
    views = [Value(20.0), Value(30.0), Value(40.0)]
    assert protocol("default").mean(views, "albedo/psnr").value == pytest.approx(30)
    assert protocol("tensoir").mean(views, "albedo/psnr").value == pytest.approx(24.32, abs=5e-3)
    assert protocol("tensoir").mean(views, "nvs/psnr").value == pytest.approx(30)
    assert protocol("tensoir").mean([*views, Value(None, "why")], "albedo/psnr") == Value(None, "why")


def test_tensoirs_albedo_is_gamma_encoded_for_psnr_only_and_white_outside() -> None:
    alpha = (disc() > 0.5).float()
    target, image = 0.4 * alpha * ONES, 0.2 * alpha * ONES
    rules = protocol("tensoir")
    scale = rules.albedo_scale([image], [target], [alpha], [alpha])
    torch.testing.assert_close(scale, 2 * ONES)
    assert rules.score_albedo(image, target, scale, alpha, alpha)["psnr"].value == PSNR_CAP
    found = rules.score_albedo(image, target, ONES, alpha, alpha)
    error = (0.4 ** (1 / 2.2) - 0.2 ** (1 / 2.2)) ** 2 * float(alpha.mean())
    assert found["psnr"].value == pytest.approx(-10 * math.log10(error), abs=1e-3)
    linear = protocol("default").score_image(0.2 * alpha * ONES + 1 - alpha, 0.4 * alpha * ONES + 1 - alpha)
    assert found["ssim"].value == pytest.approx(linear["ssim"].value, abs=1e-6)


def test_irgs_compares_linear_albedo_unclipped_and_svg_ir_in_srgb_clipped() -> None:
    ones = torch.ones(32, 32, 1)
    target, image = torch.full((32, 32, 3), 0.9), torch.full((32, 32, 3), 0.6)
    assert protocol("irgs").score_albedo(image, target, 2 * ONES, ones)["psnr"].value == pytest.approx(
        -20 * math.log10(0.3), abs=1e-3
    )
    display = 1.055 * 0.9 ** (1 / 2.4) - 0.055
    assert protocol("svg-ir").score_albedo(image, target, 2 * ONES, ones)["psnr"].value == pytest.approx(
        -20 * math.log10(1 - display), abs=1e-3
    )


def test_relighting_uses_the_aligned_albedo_where_the_code_does() -> None:
    scale = torch.tensor([2.0, 3.0, 4.0])
    unscaled = {name for name in PROTOCOLS if torch.equal(protocol(name).relighting_scale(scale), ONES)}
    assert unscaled == {"gs-ir", "gi-gs", "stanford-orb"}


def test_roughness_over_the_image_is_diluted_by_the_background() -> None:
    mask = torch.zeros(8, 8, 1)
    mask[:2] = 1
    target, image = mask * 0.5, mask * 0.6
    image[5] = math.nan
    assert protocol("default").score_roughness(image, target, mask)["mse"].value == pytest.approx(0.01, rel=1e-5)
    assert protocol("irgs").score_roughness(image, target, mask)["mse"].value == pytest.approx(0.0025, rel=1e-5)
    for name in ("default", "irgs"):
        assert protocol(name).score_roughness(image, target, 0 * mask)["mse"] == Value(None, "the mask is empty")


@pytest.mark.parametrize(
    ("name", "task"), [("irgs", "relight"), ("gs-ir", "relight"), ("r3dg", "relight"), ("radiogs", "indirect")]
)
def test_what_a_mask_excludes_cannot_leak_and_an_empty_one_is_no_perfect_score(name: str, task: str) -> None:
    rules, mask = protocol(name), (disc(48) > 0.5).float()
    image, target = torch.rand(48, 48, 3) * mask, torch.rand(48, 48, 3) * mask
    expected = rules.score_image(image, target, mask, mask, task)
    image = torch.where(mask > 0, image, math.nan)
    assert rules.score_image(image, target, mask, mask, task) == expected
    assert expected["psnr"].value is not None
    empty = rules.score_image(image, target, 0 * mask, mask, task)
    assert {value.reason for value in empty.values()} == {"the mask is empty"}


def test_maps_that_a_code_does_not_score_are_not_available() -> None:
    image, ones = torch.rand(16, 16, 3), torch.ones(16, 16, 1)
    for name, scores in {
        "r3dg": protocol("r3dg").score_normal(image, image, ones),
        "tensoir": protocol("tensoir").score_roughness(ones, ones, ones),
        "irgs": protocol("irgs").score_image(image, image, task="indirect"),
        "stanford-orb": protocol("stanford-orb").score_image(image, image, task="indirect"),
        "default": protocol("default").score_depth([ones], [ones], [ones])[0],
    }.items():
        for value in scores.values():
            assert value.value is None
            assert name in value.reason
            assert "does not compare" in value.reason


def soft_edge(size: int = 32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Straight linear truth [h, w, 3], true coverage and predicted coverage [h, w, 1], with soft edges; float64."""
    generator = np.random.default_rng(3)
    truth = generator.uniform(0.05, 0.95, (size, size, 3))
    ramp = np.clip(np.linspace(-0.5, 1.5, size), 0, 1)[None, :, None].repeat(size, 0)
    return truth, ramp, np.roll(ramp, 3, 1) * 0.9


def encode(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def decode(display: np.ndarray) -> np.ndarray:
    return np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)


def psnr_of_three(ours: np.ndarray, theirs: np.ndarray) -> float:
    return float(np.mean(-10 * np.log10(((ours - theirs) ** 2).mean((0, 1)))))


def lower_median(ratios: np.ndarray) -> np.ndarray:
    """The lower middle one of an even number of pixels, as in PyTorch."""
    return np.sort(ratios, 0)[(len(ratios) - 1) // 2]


def tensors(*arrays: np.ndarray) -> list[torch.Tensor]:
    return [torch.from_numpy(array).float() for array in arrays]


def test_r3dg_encodes_albedo_before_it_multiplies_by_the_coverage() -> None:
    straight, mask, alpha = soft_edge()
    rendered = 0.7 * straight * alpha
    expected = psnr_of_three(encode(1.2 * rendered) * mask, encode(straight) * mask)
    found = protocol("r3dg").score_albedo(*tensors(rendered, straight * mask), 1.2 * ONES, *tensors(mask, alpha))
    assert found["psnr"].value == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("name", "power"), [("r3dg", 1), ("irgs", 2), ("radiogs", 2)])
def test_roughness_over_the_image_has_the_coverage_of_each_code(name: str, power: int) -> None:
    straight, mask, alpha = soft_edge()
    truth, rendered = straight[..., :1], 0.8 * straight[..., :1] * alpha
    expected = ((rendered * mask - truth * mask**power) ** 2).mean()
    found = protocol(name).score_roughness(*tensors(rendered, truth * mask, mask))["mse"].value
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("name", "again"), [("irgs", 1), ("radiogs", 0)])
def test_irgs_composites_synthetic4relights_albedo_in_display_space(name: str, again: int) -> None:
    """The truth is decode(encode(A) a), in IRGS's script times a once more; the prediction is linear, times a."""
    straight, mask, alpha = soft_edge()
    rendered, truth = 0.7 * straight * alpha, decode(encode(straight) * mask)
    rules = protocol(name).on("synthetic4relight")
    covered = mask[..., 0] > 0
    factor = lower_median((truth / np.maximum(rendered, 1e-6))[covered])
    found = rules.albedo_scale(*([each] for each in tensors(rendered, straight * mask, mask, alpha)))
    assert found.tolist() == pytest.approx(factor.tolist(), rel=1e-5)
    scored = rules.score_albedo(*tensors(rendered, straight * mask), 1.4 * ONES, *tensors(mask, alpha))
    compared = truth * mask**again
    assert scored["psnr"].value == pytest.approx(psnr_of_three(1.4 * rendered * mask, compared), abs=1e-3)
    elsewhere = (
        protocol(name)
        .on("tensoir")
        .score_albedo(*tensors(rendered, straight * mask), 1.4 * ONES, *tensors(mask, alpha))
    )
    assert elsewhere["psnr"].value == pytest.approx(psnr_of_three(1.4 * rendered * mask, straight * mask**2), abs=1e-3)


@pytest.mark.parametrize("name", ["gs-ir", "gi-gs"])
def test_gs_ir_fits_the_factor_to_the_straight_truth_and_scales_inside_the_mask_alone(name: str) -> None:
    straight, mask, alpha = soft_edge()
    rendered = np.round(255 * 0.7 * straight * alpha) / 255
    covered = mask[..., 0] > 0
    views = tensors(rendered, straight * mask, mask, alpha)
    factor = lower_median((straight / np.maximum(rendered, 1e-6))[covered])
    found = protocol(name).albedo_scale(*([each] for each in views))
    assert found.tolist() == pytest.approx(factor.tolist(), rel=1e-5)
    rendered[:, :4] = 51 / 255  # outside the mask
    expected = psnr_of_three(np.where(mask > 0, 1.5, 1.0) * rendered, straight * (mask > 0))
    scored = protocol(name).score_albedo(*tensors(rendered, straight * mask), 1.5 * ONES, *tensors(mask, alpha))
    assert scored["psnr"].value == pytest.approx(expected, abs=2e-3)


def test_svg_ir_fits_the_factor_to_the_straight_truth_of_the_first_view() -> None:
    straight, mask, alpha = soft_edge()
    rendered = 0.7 * straight * alpha
    positive = (rendered > 0).all(-1)
    ratio = np.where(mask > 0, straight, 0)[positive] / rendered[positive]
    factor = lower_median(np.clip(ratio, 1e-6, 10))
    found = protocol("svg-ir").albedo_scale(*([each] for each in tensors(rendered, straight * mask, mask, alpha)))
    assert found.tolist() == pytest.approx(factor.tolist(), rel=1e-5)


@pytest.mark.parametrize(("name", "by_truth"), [("irgs", False), ("radiogs", False), ("svg-ir", True)])
def test_normals_that_carry_their_coverage_are_blended_by_it_again(name: str, by_truth: bool) -> None:
    """n a over (0, 0, 1) by a, or by the true coverage; then both sides become unit vectors."""
    generator = np.random.default_rng(4)
    _, mask, alpha = soft_edge()
    truth, ours = (side / np.linalg.norm(side, axis=-1, keepdims=True)
                   for side in generator.normal(size=(2, *mask.shape[:2], 3)))  # fmt: skip
    by = mask if by_truth else alpha
    behind = np.array([0.0, 0.0, 1.0])
    sides = [ours * alpha * by + behind * (1 - by), truth * mask + behind * (1 - mask)]
    unit = [side / np.linalg.norm(side, axis=-1, keepdims=True) for side in sides]
    expected = np.degrees(np.arccos(np.clip((unit[0] * unit[1]).sum(-1), -1, 1))).mean()
    found = protocol(name).score_normal(*tensors(ours * (alpha > 0), truth * (mask > 0), mask, alpha))["mae"].value
    assert found == pytest.approx(expected, abs=2e-3)


def test_titles_have_the_version_and_the_document_lists_each() -> None:
    """Whoever changes values under a name raises its version, and documents the change."""
    titles = {rules.title for rules in PROTOCOLS.values()}
    assert {"default", "r3dg@2", "stanford-orb@2"} <= titles
    assert all(rules.describe()["title"] == rules.title for rules in PROTOCOLS.values())
    text = (Path(__file__).parents[2] / "docs" / "protocols.md").read_text(encoding="utf-8")
    assert not [title for title in titles if "@" in title and f"`{title}`" not in text]


def test_one_field_changed_is_another_protocol() -> None:
    varied = replace(protocol("default"), name="mine", psnr=Psnr("mean of channels"))
    target = torch.rand(16, 16, 3)
    image = target + torch.tensor([0.1, 0.0, 0.0])
    assert varied.score_image(image.clamp(0, 1), target)["psnr"].value > 70


def test_the_document_names_every_protocol() -> None:
    text = (Path(__file__).parents[2] / "docs" / "protocols.md").read_text(encoding="utf-8")
    for name in PROTOCOLS:
        assert f"`{name}`" in text
