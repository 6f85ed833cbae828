"""Kept views: codes that decode to the scored maps, of as many views as requested."""

import numpy as np
import pytest
import torch

from bench.fake_method import CPU
from bench.perfect import EVERYTHING, SCALE, Perfect, scene_of, view_with
from radiogs_bench.scoring import report_arrays
from radiogs_bench.scoring.evaluate import Scope, evaluate
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.report_arrays import views_to_keep
from radiogs_bench.scoring.score_maps import truth
from radiogs_core.scene.scene import Scene
from radiogs_reports import maps

HALF_A_CODE = 0.5 / 255 + 1e-6
WITH_DEPTH = {**EVERYTHING, "depth": 1}


def scene(count: int = 4, **names: int) -> Scene:
    return scene_of(*(view_with(place, names or WITH_DEPTH) for place in range(count)))


def codes(model: Perfect, kept: int | None) -> dict[str, np.ndarray]:
    rules = protocol("default")
    found = evaluate(model, model.scene, rules, CPU, lambda done, total: None, Scope(timed=False, kept_views=kept))
    return {name: each for name, each in found.arrays.items() if name.startswith(maps.VIEWS)}


def test_codes_decode_to_the_maps_that_were_scored_and_to_their_truth() -> None:
    model = Perfect(scene())
    found = codes(model, 4)
    for place, view in enumerate(model.scene.test):
        for name in ("image", "albedo", "normal", "roughness", "indirect", "relit/sun", "relit/sky"):
            exact, seen = truth(view, name).numpy(), view.read("alpha").numpy() > 0
            for side in ("render", "truth"):
                decoded = maps.decoded(name, found[f"{maps.VIEWS}{place}/{side}/{name}"])
                shown = maps.kind_of(name).shown
                if name == "indirect":
                    decoded, wanted = maps.display(decoded), maps.display(exact)
                else:
                    decoded, wanted = shown(decoded), shown(exact)
                assert np.abs(decoded - wanted)[seen[..., 0]].max() <= HALF_A_CODE + 1e-3 * (name == "albedo"), name
    assert torch.allclose(model.scales[0], SCALE), "albedo is kept as it was aligned"


def test_normals_and_depths_say_where_there_is_no_surface() -> None:
    found = codes(Perfect(scene()), 4)
    bare = Perfect(scene()).scene.test[0].read("alpha").numpy()[..., 0] == 0
    for name, side in (("normal", "render"), ("normal", "truth"), ("depth", "render")):
        kept = found[f"views/0/{side}/{name}"]
        assert (kept[bare] == 0).all()
        assert (kept[~bare].max(-1) > 0).all()


def test_depth_is_kept_over_the_range_of_the_truth_whoever_renders_it() -> None:
    model = Perfect(scene())
    view = model.scene.test[0]
    exact = truth(view, "depth").numpy()[..., 0]
    seen = exact > 0
    low, high = exact[seen].min(), exact[seen].max()
    near, far = low - 0.1 * (high - low), high + 0.1 * (high - low)
    found = codes(model, 4)
    wanted = 255 * (1 - (exact - near) / (far - near))
    assert found["views/0/truth/depth"][..., 0][seen] == pytest.approx(wanted[seen], abs=0.501)
    rendered = found["views/0/render/depth"][..., 0]
    inside = seen & (view.read("alpha").numpy()[..., 0] > 0.5)
    assert (rendered[inside] > found["views/0/truth/depth"][..., 0][inside]).all(), "a third as far: in front of all"


def test_as_many_views_are_kept_as_asked_for_the_shown_one_among_them() -> None:
    many = scene(9, image=3)
    assert views_to_keep(many, 0) == frozenset()
    assert views_to_keep(many, 1) == {"view_4"}
    assert views_to_keep(many, 3) == {"view_1", "view_4", "view_7"}
    assert len(views_to_keep(many, 99)) == 9
    assert codes(Perfect(many), 0) == {}
    assert {name.split("/")[1] for name in codes(Perfect(many), 3)} == {"1", "4", "7"}


def test_without_a_number_as_many_are_kept_as_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A view has at most 14 channels of maps and 3 of each of two lights, predicted and true."""
    model, bytes_of_view = Perfect(scene(4)), 2 * (14 + 2 * 3) * 16 * 16
    assert len(views_to_keep(model.scene, None)) == 4
    monkeypatch.setattr(report_arrays, "KEPT_BYTES", 3 * bytes_of_view - 1)
    assert len(views_to_keep(model.scene, None)) == 2
    assert sum(each.nbytes for each in codes(model, None).values()) == 2 * bytes_of_view
    monkeypatch.setattr(report_arrays, "KEPT_BYTES", 1)
    assert views_to_keep(model.scene, None) == {"view_2"}


def test_metrics_do_not_depend_on_what_is_kept() -> None:
    rules, scenes = protocol("default"), scene()

    def metrics(kept: int | None) -> object:
        scope = Scope(timed=False, kept_views=kept)
        return evaluate(Perfect(scenes, {"image": 0.1}), scenes, rules, CPU, lambda done, total: None, scope).metrics

    assert metrics(0) == metrics(None)
