"""The audit of plans: its tables and its figure against values worked out by hand from a made-up run."""

import copy
from typing import Any

import numpy as np
import pytest
from scipy import stats

from made_up_run import cell, in_every_form, run, summary, t_interval
from radiogs_reports.analysis.audit import audit_report
from radiogs_reports.analysis.audit_lines import AuditLine, audit_lines, judged, left_out, over_seeds
from radiogs_reports.analysis.report import Item
from radiogs_reports.figures.audit import audit_figure
from radiogs_reports.run_folder import texts
from radiogs_reports.statistics import Estimate
from radiogs_reports.summary import Summary

SEEDS = (0, 1, 2)
COLUMNS = ("nvs/psnr", "albedo/psnr", "relight/psnr")
WHOLE = {
    "visibility": True, "indirect": True, "bounces": True, "specular": True, "light_sampling": True, "sh_degree": 3,
    "samples": 1, "refresh": 1,
}  # fmt: skip
NO_RAYS = {"visibility": False, "indirect": False}
LOSSES = {"ball": (0.01, 0.02, 0.03), "room": (1.0, 1.1, 1.2)}
"""Losses of NVS PSNR under ``auto``: 0.02 and 1.1 dB in the mean; half-widths t(0.975, 2 degrees) = 4.3027 times s /
sqrt 3, 0.0248 and 0.248 dB."""

BOUNDS = {"ball": (0.05, 0.04, 0.01), "room": (0.08, 0.0, 0.07)}


def made_up() -> Summary:
    """Two scenes of three seeds; ``auto`` left rays out, of one seed in part, and ``no-rays`` by hand."""
    made = summary()
    made["title"], made["suite"], made["reference"] = "Plans & more", "effects", "everything"
    made["scenes"], made["seeds"], made["paper"], made["sheet"], made["published"] = (
        ["ball", "room"],
        [*SEEDS],
        [],
        [],
        {},
    )
    keys = ("everything", "auto", "no-rays")
    made["rows"] = [{"key": key, "latex": key, "text": f"{key}_row", "seconds": 1.0} for key in keys]
    made["columns"] = [
        {"key": key, "label": key, "unit": "dB", "direction": "up", "decimals": 2} for key in COLUMNS
    ]  # fmt: skip
    made["cells"] = {key: {column: cell(30.0) for column in COLUMNS} for key in keys}
    made["runs"] = [one(scene, row, seed) for scene in made["scenes"] for row in keys for seed in SEEDS]
    return made


def one(scene: str, row: str, seed: int) -> Any:
    """A cell: every seed has another level, so that only pairs give the losses."""
    loss = {"everything": 0.0, "auto": LOSSES[scene][seed], "no-rays": 2.0}[row]
    level = 30.0 + 5 * seed
    made = run(row, scene, seed, f"{scene}-{row}-{seed}", dict.fromkeys(COLUMNS))
    made["metrics"] = {"nvs/psnr": level - loss, "albedo/psnr": level - 3 * loss, "relight/psnr": level + loss}
    seconds = {"everything": 8.0, "auto": (4.0, 8.0, 2.0)[seed], "no-rays": 2.0}[row]
    made["seconds"] = {"initialise": 8.0, "invert": seconds, "evaluate": 99.0}
    rays = {"everything": 1000, "auto": (100, 500, 300)[seed], "no-rays": 0}[row]
    made["work"] = {"initialise": {}, "invert": {"rays": rays} if rays else {}, "evaluate": {"rays": 12345}}
    chosen = {"everything": "all", "auto": "auto", "no-rays": ["specular"]}[row]
    made["made_from"] = {"experiment": "audit", "variant": {"effects": chosen}}
    plan = {
        "everything": WHOLE,
        "auto": WHOLE | (NO_RAYS if seed else {"indirect": False}),
        "no-rays": WHOLE | NO_RAYS,
    }[row]
    auto = row == "auto"
    made["effects"] = {
        "plan": plan, "bound": BOUNDS[scene][seed] if auto else 0.0, "tolerance": 0.1 if auto else None,
        "probing": {"seconds": 0.1 * (seed + 1) if auto else 0.0, "rays": 40.0 if auto else 0.0},
    }  # fmt: skip
    return made


def line_of(made: Summary, scene: str, row: str) -> AuditLine:
    (line,) = [line for line in audit_lines(made) if (line.scene, line.row) == (scene, row)]
    return line


def item(made: Summary, scene: str, row: str, head: str) -> Item:
    report = audit_report(made)
    assert report is not None
    (grid,) = report.grids
    (line,) = [line for line in grid.rows if (line[0].text, line[1].text) == (scene, f"{row}_row")]
    (place,) = [place for place, each in enumerate(grid.heads) if each.startswith(head)]
    return line[place]


def test_there_is_a_line_for_each_scene_and_row_that_leaves_something_out() -> None:
    assert [(line.scene, line.row, line.seeds) for line in audit_lines(made_up())] == [
        ("ball", "auto", 3), ("ball", "no-rays", 3), ("room", "auto", 3), ("room", "no-rays", 3),
    ]  # fmt: skip


@pytest.mark.parametrize("scene", LOSSES)
def test_losses_are_paired_over_seeds_and_positive_where_it_is_worse(scene: str) -> None:
    losses = line_of(made_up(), scene, "auto").losses
    for name, sign in (("nvs", 1), ("albedo", 3), ("relight", -1)):
        found, given = losses[name], [sign * each for each in LOSSES[scene]]
        assert found is not None
        assert found.mean == pytest.approx(np.mean(given))
        assert (found.low, found.high) == pytest.approx(t_interval(given))


def test_the_table_has_the_values_computed_by_hand_and_the_sentences_count_the_scenes() -> None:
    made = made_up()
    report = audit_report(made)
    assert report is not None
    assert {head: item(made, "ball", "auto", head).text for head in report.grids[0].heads} == {
        "scene": "ball", "row": "auto_row", "NVS loss, dB": "+0.020 ± 0.025", "albedo loss, dB": "+0.060 ± 0.075",
        "relighting loss, dB": "-0.020 ± 0.025", "predicted bound, dB": "0.050", "NVS loss under it": "yes",
        # Saved: 90, 50 and 70 %; probes: 0.1 of 4 and 12 s, 0.2 of 8 and 16, 0.3 of 2 and 10.
        "rays saved": "70.0 ± 49.7 %", "probes, share of stage 2": "6.7 ± 17.9 %",
        "probes, share of training": "1.7 ± 2.9 %",
        # Stage 2 is 2, 1 and 4 times as fast, all of it 16 s against 12, 16 and 10.
        "stage 2, times as fast": "2.00 (0.36 to 11.19)", "training, times as fast": "1.29 (0.71 to 2.32)",
        "left out at the end": "no indirect light (seed 0); no rays (seeds 1, 2)",
    }  # fmt: skip
    assert report.sentences == [
        "auto_row: NVS loss +0.020 dB (ball) to +1.100 dB (room).",
        "auto_row: NVS loss under the predicted bound in 1 of 2 scenes, no in 1; its 95 % interval is under the"
        " tolerance of 0.1 dB in 1 of 2.",
        "no-rays_row: NVS loss +2.000 dB (ball) to +2.000 dB (room).",
    ]


def test_ratios_of_seconds_are_geometric_means() -> None:
    line = line_of(made_up(), "room", "auto")
    ratios = {"last_stage": [2, 1, 4], "training": [16 / 12, 16 / 16, 16 / 10]}
    for name, given in ratios.items():
        found = line.shares[f"{name}_times_as_fast"]
        assert found is not None
        assert found.mean == pytest.approx(stats.gmean(given))
        assert (found.low, found.high) == pytest.approx(np.exp(t_interval(np.log(given))))


def whole(estimate: Estimate | None) -> tuple[float, float | None, float | None, int]:
    assert estimate is not None
    return estimate.mean, estimate.low, estimate.high, estimate.units


def test_rays_of_evaluation_do_not_count_and_a_row_without_rays_saves_all() -> None:
    line = line_of(made_up(), "ball", "no-rays")
    assert whole(line.shares["rays_saved"]) == (1.0, 1.0, 1.0, 3)
    assert whole(line_of(made_up(), "ball", "auto").shares["probe_rays_share"]) == (0.04, 0.04, 0.04, 3)


def test_rows_by_hand_have_no_bound_and_say_so() -> None:
    made = made_up()
    assert line_of(made, "room", "no-rays").bound is None
    assert item(made, "room", "no-rays", "predicted bound").text == "none"
    assert "by hand" in item(made, "room", "no-rays", "predicted bound").reason
    assert item(made, "room", "no-rays", "NVS loss under it").text == "by hand"
    assert item(made, "room", "no-rays", "probes, share of training").text == "none"


@pytest.mark.parametrize(
    ("loss", "bound", "judgement"),
    [
        (Estimate(0.05, -0.1, 0.2, 3), 0.05, "yes"),
        (Estimate(0.0, 0.0, 0.0, 3), 0.0, "yes"),
        (Estimate(0.06, 0.05, 0.07, 3), 0.05, "within noise"),
        (Estimate(0.06, 0.051, 0.07, 3), 0.05, "no"),
        (Estimate(0.06, None, None, 1), 0.05, "above"),
        (Estimate(0.06, 0.0, 0.1, 3), None, None),
        (None, 0.05, None),
    ],
)
def test_a_loss_is_judged_by_its_mean_and_then_by_its_interval(
    loss: Estimate | None, bound: float | None, judgement: str | None
) -> None:
    assert judged(loss, bound) == judgement


def test_a_seed_that_one_row_lacks_does_not_count() -> None:
    made = made_up()
    for each in made["runs"]:
        if (each["row"], each["scene"], each["seed"]) in (("everything", "ball", 0), ("auto", "ball", 2)):
            each["metrics"] = {}
    line = line_of(made, "ball", "auto")
    assert (line.seeds, line.bound) == (1, 0.04)
    assert line.losses["nvs"] == Estimate(pytest.approx(0.02), None, None, 1)
    assert item(made, "ball", "auto", "NVS loss, dB").text == "+0.020"
    assert line.left_out == "no rays"


def test_a_value_that_results_do_not_hold_is_missing() -> None:
    made = made_up()
    made["columns"] = made["columns"][:1]
    for each in made["runs"]:
        each["metrics"] = {"nvs/psnr": each["metrics"]["nvs/psnr"]}
        assert each["effects"] is not None
        each["effects"]["probing"] = None
    assert item(made, "ball", "auto", "probes, share of training") == Item(
        "n/a", None, "these results are from before probes were timed"
    )
    assert item(made, "ball", "auto", "albedo loss").text == "n/a"
    assert item(made, "ball", "auto", "NVS loss, dB").text == "+0.020 ± 0.025"


def test_a_run_that_is_no_audit_has_no_audit_report() -> None:
    made = made_up()
    for each in made["runs"]:
        each["made_from"]["experiment"] = "training"
    assert audit_report(made) is None
    assert audit_figure(made) == []
    assert not any("audit" in name for name in texts(made))
    made = made_up()
    made["runs"] = [each for each in made["runs"] if each["row"] == "everything"]
    assert audit_report(made) is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "nothing"),
        (NO_RAYS, "no rays"),
        ({"indirect": False}, "no indirect light"),
        ({"visibility": False, "specular": False}, "no visibility, no lobes"),
        ({"sh_degree": 1}, "own radiance of degree 1"),
        ({"samples": 2, "refresh": 4}, "1/2 of the directions, all surfels re-traced 1/4 as often"),
        ({"bounces": False, "light_sampling": False}, "one bounce, no light sampling"),
    ],
)
def test_plans_are_described_in_words(changes: dict[str, Any], said: str) -> None:
    assert left_out(WHOLE | changes) == said


def test_seeds_are_named_where_they_differ() -> None:
    assert over_seeds({0: "no rays", 1: "no rays"}) == "no rays"
    assert over_seeds({2: "a", 0: "a", 1: "b"}) == "a (seeds 0, 2); b (seed 1)"


def test_every_form_has_the_values_and_the_csv_a_line_for_each_scene_and_row() -> None:
    stored = in_every_form(made_up(), "audit").set_index(["scene", "row"])
    line = stored.loc["room", "auto"]
    assert len(stored) == 4
    assert line[["nvs_loss", "nvs_loss_low", "nvs_loss_high"]].tolist() == pytest.approx(
        [1.1, *t_interval(LOSSES["room"])]
    )
    assert (line.bound, line.tolerance, line.under_bound, line.seeds) == (0.08, 0.1, "no", 3)
    assert line.rays_saved == pytest.approx(0.7)
    assert line.probe_rays_share == pytest.approx(0.04)
    assert (
        stored.loc["room", "no-rays"][["bound", "under_bound", "probes_of_last_stage", "probes_of_training"]]
        .isna()
        .all()
    )


def test_the_figure_holds_bounds_losses_diagonal_and_tolerance() -> None:
    (sketch,) = audit_figure(made_up())
    axes = sketch.figure.axes[0]
    points = np.concatenate([bar[0].get_xydata() for bar in axes.containers])
    assert points == pytest.approx(np.array([[0.05, 0.02], [0.08, 1.1]]))
    bars = [segment for bar in axes.containers for segment in bar[2][0].get_segments()]
    assert [tuple(bar[:, 1]) for bar in bars] == [pytest.approx(t_interval(LOSSES[scene])) for scene in LOSSES]
    lines = [np.asarray(line.get_xydata()) for line in axes.get_lines()]
    assert any(len(line) > 2 and np.array_equal(line[:, 0], line[:, 1]) and line[-1, 0] >= 0.1 for line in lines)
    assert any(np.array_equal(line[:, 1], [0.1, 0.1]) for line in lines)
    assert any(np.array_equal(line[:, 0], [0.1, 0.1]) for line in lines)
    # A loss of eleven tolerances is shown beside one of a fifth.
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "symlog")
    assert axes.get_ylim()[1] > t_interval(LOSSES["room"])[1]


def test_scenes_that_leave_nothing_out_are_labelled_and_rows_have_panels_of_their_own() -> None:
    made = made_up()
    more = [copy.deepcopy(each) for each in made["runs"] if each["row"] == "auto"]
    for each in more:
        each["row"] = "no-rays"
        assert each["effects"] is not None
        if each["scene"] == "ball":
            each["effects"]["bound"] = 0.0
    made["runs"] = [each for each in made["runs"] if each["row"] != "no-rays"] + more
    (sketch,) = audit_figure(made)
    assert [axes.get_title() for axes in sketch.figure.axes] == ["auto_row", "no-rays_row"]
    for each in made["runs"]:
        if each["scene"] == "ball" and each["effects"] is not None:
            each["effects"]["bound"] = 0.0
    (sketch,) = audit_figure(made)
    assert [text.get_text() for text in sketch.figure.legends[0].get_texts()] == [
        "ball: nothing left out", "room", "loss = bound", "tolerance",
    ]  # fmt: skip
