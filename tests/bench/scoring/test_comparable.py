"""Which metrics of two protocols may stand beside each other."""

from dataclasses import replace

import pytest

from radiogs_bench.scoring.metrics.conventions import Albedo, Lpips, Normal, Picture, Psnr, Roughness, Ssim
from radiogs_bench.scoring.metrics.protocol import Protocol, alike
from radiogs_bench.scoring.metrics.protocols import protocol

IMAGES = ("nvs", "relight", "albedo", "indirect")
METRICS = (
    *(f"{task}/{measure}" for task in IMAGES for measure in ("psnr", "ssim", "lpips")), "normal/mae", "roughness/mse",
)  # fmt: skip
RULES = protocol("radiogs")


@pytest.mark.parametrize(
    ("other", "changed"),
    [
        (replace(RULES, name="another"), set()),
        (replace(RULES, psnr=Psnr()), {"nvs/psnr", "relight/psnr", "albedo/psnr", "indirect/psnr"}),
        (replace(RULES, ssim=Ssim()), {"nvs/ssim", "relight/ssim", "albedo/ssim", "indirect/ssim"}),
        (replace(RULES, lpips=(Lpips(),)), {"nvs/lpips", "relight/lpips", "albedo/lpips", "indirect/lpips"}),
        (replace(RULES, nvs=Picture(background="white")), {"nvs/psnr", "nvs/ssim", "nvs/lpips"}),
        (replace(RULES, relight=Picture()), {"relight/psnr", "relight/ssim", "relight/lpips"}),
        (replace(RULES, normal=Normal()), {"normal/mae"}),
        (replace(RULES, roughness=Roughness()), {"roughness/mse"}),
        (
            replace(RULES, albedo=Albedo()),
            {f"{task}/{measure}" for task in ("relight", "albedo") for measure in ("psnr", "ssim", "lpips")},
        ),
    ],
)  # fmt: skip
def test_a_convention_concerns_its_own_metrics(other: Protocol, changed: set[str]) -> None:
    """Relit images depend on the albedo's alignment as well."""
    assert {metric for metric in METRICS if not alike(RULES, other, metric)} == changed


def test_costs_are_comparable_between_all_protocols() -> None:
    assert all(alike(RULES, protocol("default"), metric) for metric in ("render/ms", "training/hours", "nvs/ms/bonsai"))
    assert not any(alike(RULES, protocol("default"), metric) for metric in METRICS)
