"""Whatever a cell stores can be a column, and metrics of two protocols stand beside each other where they are alike."""

from dataclasses import replace

import pytest
import torch

from bench.fake_method import CPU, model_at
from bench.perfect import EVERYTHING, scene_of, view_with
from radiogs.settings import PRESETS, Variant
from radiogs.showing import TrainedRadioGS
from radiogs_bench.results.summary import column_summary
from radiogs_bench.scoring.evaluate import evaluate
from radiogs_bench.scoring.metrics.conventions import Albedo, Lpips, Normal, Picture, Psnr, Roughness, Ssim
from radiogs_bench.scoring.metrics.measures import MEASURES
from radiogs_bench.scoring.metrics.protocol import Protocol, alike
from radiogs_bench.scoring.metrics.protocols import PROTOCOLS, protocol
from radiogs_bench.scoring.metrics.weights import FILES
from radiogs_bench.suites.suite import TASKS, Metric
from radiogs_core.contract import Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene

MODEL = model_at(torch.zeros(3))


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Has every ground truth that anything is compared with."""
    views = scene_of(*(view_with(place, EVERYTHING | {"depth": 1}) for place in range(2)))
    return replace(views, training_light=EnvironmentMap(MODEL.environment.detach() + 0.1))


@pytest.mark.slow
@pytest.mark.parametrize("rules", PROTOCOLS)
def test_every_metric_that_evaluation_stores_can_be_a_column(rules: str, scene: Scene) -> None:
    trained = TrainedRadioGS(MODEL, Run(scene, Variant(), PRESETS["smoke"], 0, CPU))
    found = evaluate(trained, scene, protocol(rules), CPU, lambda done, total: None)
    stored = found.metrics | found.timings
    tasks = {Metric.of(key).task for key in stored}
    assert tasks >= {"nvs", "normal", "albedo", "roughness", "indirect", "relight", "environment"}
    for key in stored:
        column = column_summary(Metric.of(key))
        assert column["label"].startswith(TASKS[Metric.of(key).task].label)
        assert column["direction"] in {"up", "down", "zero"}
        assert column["decimals"] >= 0
        assert column["meaning"].endswith(f" {TASKS[Metric.of(key).task].meaning}")
        assert column["meaning"].startswith(MEASURES[Metric.of(key).measure].meaning)


def test_every_network_of_lpips_has_a_heading_of_its_own() -> None:
    labels = [MEASURES[f"lpips_{net}"].label for net in FILES]
    assert len({*labels, MEASURES["lpips"].label}) == len(FILES) + 1


def test_errors_fall_and_ratios_of_signal_to_noise_rise() -> None:
    better = {name: measure.better for name, measure in MEASURES.items()}
    assert {name for name, way in better.items() if way == "up"} == {
        "psnr",
        "psnr_h",
        "psnr_l",
        "psnr_reference",
        "ssim",
    }
    for name, measure in MEASURES.items():
        # The cost of a plan is a difference of PSNR.
        assert (measure.unit == "dB") == (name.startswith("psnr") or name in ("bound", "worst"))


def test_no_two_measures_share_a_heading() -> None:
    labels = [measure.label for measure in MEASURES.values()]
    assert len(set(labels)) == len(labels)


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
