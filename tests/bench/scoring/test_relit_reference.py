"""Relit views against the method's reference mode: bias and PSNR, in the scores of a cell that asks for them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.fake_method import CPU
from bench.perfect import EVERYTHING, Perfect, Relit, name_of, scene_of, view_with
from known_ball import BALL, WHITE, ball_scene
from radiogs.model import Model
from radiogs.settings import PRESETS, Variant
from radiogs.showing import TrainedRadioGS
from radiogs_bench.cli.main import main
from radiogs_bench.scoring.evaluate import Evaluation, Scope, evaluate
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.score_maps import against_reference
from radiogs_core.capabilities import RelitByReference
from radiogs_core.contract import Run, Trained
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_reports.summary import read_summary

MEASURES = ("relight/bias", "relight/psnr_reference")


class Referring(Perfect):
    """Its reference shows the truth; what it shows itself may differ from that by ``wrong``."""

    def reference(self, light: EnvironmentMap, albedo_scale: torch.Tensor, after_step: Callable[[], None]) -> Relit:
        true = Perfect(self.scene)
        return Relit(true, name_of(light, self.scene))


def scored(model: Trained, scene: Scene, reference: bool = True) -> Evaluation:
    scope = Scope(timed=False, reference=reference)
    return evaluate(model, scene, protocol("default"), CPU, lambda done, total: None, scope)


def test_an_image_twice_as_bright_has_a_bias_of_a_hundred_percent() -> None:
    radiance = 0.1 + 0.3 * torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(0))
    mask = torch.ones(8, 8, 1)
    mask[:, 4:] = 0
    twice = radiance.clone()
    twice[:, :4] *= 2
    found = against_reference(srgb_encode(twice), srgb_encode(radiance), mask)
    assert found["bias"].value == pytest.approx(100, abs=0.01)
    darker = against_reference(srgb_encode(radiance), srgb_encode(twice), mask)
    assert darker["bias"].value == pytest.approx(-50, abs=0.01)
    expected = (srgb_encode(twice) - srgb_encode(radiance)).square()[:, :4].sum() / (8 * 8 * 3)
    assert found["psnr_reference"].value == pytest.approx(-10 * float(expected.log10()), abs=1e-3)


def test_a_black_reference_has_no_bias() -> None:
    found = against_reference(torch.full((4, 4, 3), 0.5), torch.zeros(4, 4, 3), torch.ones(4, 4, 1))
    assert found["bias"].value is None
    assert found["psnr_reference"].value == pytest.approx(-10 * float(torch.tensor(0.25).log10()), abs=1e-4)


def test_a_view_is_compared_with_the_reference_mode_not_the_truth() -> None:
    scene = scene_of(view_with(0, EVERYTHING), view_with(1, EVERYTHING))
    found = scored(Referring(scene, {"relit/sun": 0.1}), scene).metrics
    mask = scene.test[0].read("alpha")
    expected = -10 * float(torch.log10((0.1 * mask).square().mean()))
    # The mean over lights: under the sky there is no difference, which counts as 100 dB.
    assert found["relight/psnr_reference"]["value"] == pytest.approx((expected + 100) / 2, abs=0.2)
    assert (found["relight/bias"]["value"] or 0) > 1


def test_it_is_scored_only_where_it_is_asked_for() -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    assert not set(MEASURES) & scored(Referring(scene), scene, reference=False).metrics.keys()


def test_a_method_without_a_reference_has_none_to_compare_with() -> None:
    scene = scene_of(view_with(0, EVERYTHING))
    assert not isinstance(Perfect(scene), RelitByReference)
    found = scored(Perfect(scene), scene).metrics
    for name in MEASURES:
        assert found[name]["value"] is None
        assert "has no reference" in str(found[name]["reason"])


@pytest.mark.parametrize("mode", ["pbr", "bounces", "surfels", "path"])
def test_every_mode_of_radiogs_is_compared_with_path_tracing(mode: Any) -> None:
    """A ball alone, so that no mode but that of surfels has anything to err in."""
    plain = ball_scene(views=4)
    test = tuple(replace(view, sources={**view.sources, "relit/white": view.sources["image"]}) for view in plain.test)
    scene = replace(plain, test=test)
    run = Run(scene, Variant(relighting=mode), PRESETS["smoke"], 0, CPU)
    found = scored(TrainedRadioGS(Model(BALL, WHITE), run), scene).metrics
    assert found["relight/bias"]["value"] == pytest.approx(0, abs=30 if mode == "surfels" else 2)
    assert (found["relight/psnr_reference"]["value"] or 0) > (15 if mode == "surfels" else 35)


@pytest.mark.slow
def test_the_suite_has_a_bias_for_the_new_modes(tmp_path: Path) -> None:
    """One model at preset smoke, relit by bounces and by paths."""
    asked = ["run", "relight-cost", "--scenes", "convex", "--preset", "smoke", "--rows"]
    rows = ("recommended-split-sum", "recommended-bounces", "recommended-path")
    assert main([*asked, ",".join(rows), "--out", str(tmp_path)]) == 0
    cells = read_summary(tmp_path)["cells"]
    for row in rows:
        for name in (*MEASURES, "relight/psnr", "render/ms", "prepare/ms"):
            assert cells[row][name]["mean"] is not None, (row, name)
    noise, bias = (abs(cells[row]["relight/bias"]["mean"] or 0) for row in rows[:0:-1])
    assert noise < 1
    assert bias < 3
