"""Suites are sound data, and a wrong name is answered with the right one."""

import json
from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.chain_method import Chain
from bench.fake_method import SCENE, asked
from radiogs.recipes import PRINTED, RECIPES
from radiogs.settings import PRESETS, Variant
from radiogs_baselines.published import published, published_tables
from radiogs_bench.fetching.catalogue import data_set
from radiogs_bench.installed_methods import method_names, substitutes
from radiogs_bench.methods import DEFAULT, method, variant_by_recipe
from radiogs_bench.results.invariance import SAME, TOLERANCES, invariance_kept
from radiogs_bench.runs.plan import planned
from radiogs_bench.runs.rows import of_methods, with_effects, with_rows
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.runs.sweep import CellRef
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.baselines import BASELINES
from radiogs_bench.suites.consistency import CLOSED, CONSISTENCY_LENGTH, DEPARTURE_GROUPS, DEPARTURES, RIVALS
from radiogs_bench.suites.data_sets import CAPTURES, as_published
from radiogs_bench.suites.own import HARD_TRAINING
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_bench.suites.registry import SUITES, suite
from radiogs_bench.suites.suite import COLUMNS, NUMBER, PAPER_BUDGET, Metric, Row, Suite
from radiogs_core.contract import scaled
from radiogs_core.errors import NumericalFailure, UsageError
from radiogs_core.plain_values import flat, to_plain
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene
from radiogs_datasets import known_names, load_scene, scene_choices, scene_kind, scene_names
from radiogs_datasets.data_root import OTHERS
from radiogs_datasets.hard_scenes import BASE, CONDITIONS
from radiogs_datasets.registry import scene_folder

OTHER_METHODS = {"tensoir", "gs-ir", "gi-gs", "r3dg", "irgs", "svg-ir"}
WHOLE_TABLES = {
    "ablations", "tensoir", "synthetic4relight", "relight-cost", "efficiency", "mipnerf360-ng", "mipnerf360-ns"
}  # fmt: skip
MEASURED_APART = {"training/hours", "relight/samples"}


def test_the_ablations_are_the_five_rows_of_the_paper() -> None:
    assert [cell.variant for _, cell in asked().cells] == [
        Variant(),
        Variant(radiometric_weight=0.0),
        Variant(detach="pbr"),
        Variant(detach="surfel"),
        Variant(initialise="nvs"),
    ]
    assert ABLATIONS.reference == "ours"


def test_suites_are_found_by_the_name_they_carry() -> None:
    for name in SUITES:
        assert suite(name).name == name


def test_every_column_has_a_heading_and_a_way_to_be_better() -> None:
    for column in (column for each in SUITES.values() for column in each.columns):
        assert Metric.of(column.key) == column
        assert column.label
        # A bias is better the nearer it is to zero, from either side; everything else has a better end.
        assert COLUMNS[column.measure].better in ({"zero"} if column.measure == "bias" else {"up", "down"})


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("ablationss", "Did you mean 'ablations'?"),
        ("mipnerf360", "Did you mean 'mipnerf360-ng' or 'mipnerf360-ns'?"),
        ("xyz", f"There are: {', '.join(SUITES)}."),
    ],
)
def test_a_misspelt_suite_is_refused_with_the_nearest_name(name: str, says: str) -> None:
    with pytest.raises(UsageError) as caught:
        suite(name)
    assert caught.value.why == says
    assert caught.value.remedy.endswith("radiogs-bench run --list")


def test_a_suite_without_its_reference_row_or_with_rows_of_one_name_is_refused() -> None:
    rows = (Row("a", "A", "A"), Row("a", "B", "B"))
    with pytest.raises(UsageError, match="same key: a"):
        Suite("s", "S", "p", "a", rows, (Metric("nvs", "psnr"),))
    with pytest.raises(UsageError, match="no row 'b'"):
        Suite("s", "S", "p", "b", rows[:1], (Metric("nvs", "psnr"),))
    assert Suite("s", "S", None, None, rows[:1], (Metric("nvs", "psnr"),)).reference is None


def test_rows_of_a_suite_are_rows_of_its_published_table() -> None:
    """Rows of a suite and its published table have the same keys, but for rows of other methods and other recipes."""
    for each in SUITES.values():
        if each.published is not None and each is not CLOSED:
            rows = published(each.published).figures
            printed = [row for row in each.rows if row.recipe != "recommended"]
            ours = {row.key for row in printed if row.method == DEFAULT}
            assert ours <= {key for key in rows if key not in OTHER_METHODS}, each.name
            assert {row.key for row in printed} - ours <= OTHER_METHODS, each.name


def test_beside_other_methods_radiogs_has_a_printed_and_a_recommended_row() -> None:
    """Suites of RadioGS alone compare variants of its default, but for milliseconds and the paper's rates."""
    checked = []
    for each in SUITES.values():
        ours = [row for row in each.rows if row.method == DEFAULT]
        if not ours or len(ours) == len(each.rows):
            printed = each.name in ("ns", "mipnerf360-ng", "mipnerf360-ns", "closed")
            assert each.recipe == ("printed" if printed else ""), each.name
            continue
        printed, again = ([row for row in ours if row.recipe == recipe] for recipe in ("", "recommended"))
        assert each.recipe == "printed", each.name
        assert len(printed) + len(again) == len(ours) > len(printed) > 0, each.name
        new = [{"relighting": mode} for mode in ("bounces", "path")]  # modes that the paper lacks
        assert all(row.variant in [*new, *(other.variant for other in printed)] for row in again), each.name
        checked.append(each.name)
    assert {"tensoir", "synthetic4relight", "stanford-orb", "baselines", "indirect", "relight-cost"} <= {*checked}


def test_every_published_table_has_a_suite_that_runs_it_as_it_was_made() -> None:
    parts = (BASELINES, CLOSED)  # each with some of the rows of another suite
    suites = {each.published: as_published(each) for each in SUITES.values() if each.published and each not in parts}
    assert suites.keys() == set(published_tables())
    for key, each in suites.items():
        conditions = published(key).conditions
        assert (each.scenes, each.protocol, each.data_set) == (
            conditions.scenes, conditions.protocol, conditions.data_set
        )  # fmt: skip
        assert each.recipe == "printed", key
        assert data_set(each.data_set).pieces
        assert each.download
    assert {key for key, each in suites.items() if each.data_set == "tensoir-ind"} == {"indirect", "views"}


@pytest.mark.parametrize("key", published_tables())
def test_a_published_table_has_one_suite_of_all_its_rows_that_come_with_the_package(key: str) -> None:
    """Its first suite. ``baselines`` is another one of the main table, with one row a method, and ``closed`` of the
    ablation, with its first two rows."""
    whole, *others = [each for each in SUITES.values() if each.published == key]
    rows = published(key).figures.keys()
    shared = {row.key for row in whole.rows if row.key in rows or (row.method == DEFAULT and not row.recipe)}
    assert shared == {each for each in rows if each not in OTHER_METHODS - {*method_names()}}
    assert [each.name for each in others] == {"tensoir": ["baselines"], "ablation": ["closed"]}.get(key, [])


def test_every_published_column_that_a_run_measures_by_itself_is_a_column() -> None:
    for each in SUITES.values():
        if each.name in WHOLE_TABLES:
            columns = published(each.published or "").columns
            printed = {name for name, column in columns.items() if column.scene is None}
            assert printed - MEASURED_APART <= {column.key for column in each.columns}, each.name


def test_no_two_rows_of_a_suite_run_the_same_thing() -> None:
    for each in SUITES.values():
        runs = [(row.method, row.recipe, row.variant, row.budget, row.settings, row.given) for row in each.rows]
        assert not [run for run in runs if runs.count(run) > 1], each.name


@pytest.fixture(scope="module")
def truth() -> Scene:
    """A scene whose light and surfaces are known, which some rows are given."""
    light = EnvironmentMap(torch.ones(2, 4, 3))
    return replace(SCENE, training_light=light, surfaces=load_scene("convex").surfaces)


@pytest.mark.parametrize("each", SUITES.values(), ids=SUITES)
@pytest.mark.parametrize("preset", PRESETS)
def test_every_row_runs_under_every_preset_and_differs_there(each: Suite, preset: str, truth: Scene) -> None:
    """Rounding must not make two rows one cell."""
    scene = replace(truth, name=each.scenes[0])
    request = planned(each, {scene.name: scene}, RunSpec(each.name, preset=preset))
    assert len({cell.key for _, cell in request.cells}) == len(each.rows)


def test_every_suite_has_scenes_at_hand_or_states_their_source() -> None:
    for each in SUITES.values():
        assert protocol(each.protocol).name == each.protocol
        if each.download:
            assert not set(each.scenes) & {*known_names()}, each.name
        else:
            assert set(each.scenes) <= {*known_names()}, each.name


def test_the_paper_preset_relights_by_as_many_rays_as_each_row_states() -> None:
    """Rows of table efficiency are shares of the preset; at the paper's they are its numbers."""
    request = asked(1, SUITES["efficiency"], "paper")
    for place, cell in request.cells:
        _, _, rays = place["row"].partition("traced-")
        if rays:
            assert cell.budget.relight_hemisphere_samples + cell.budget.relight_light_samples == int(rays)
            assert published("efficiency").figures[place["row"]]["relight/samples"] == int(rays)
        else:
            assert cell.variant == Variant(relighting="surfels")


def test_suite_stanford_orb_has_the_42_captures() -> None:
    """14 objects, three places each, of which 7 are the benchmark's own subset for light."""
    scenes = SUITES["stanford-orb"].scenes
    assert len(set(scenes)) == len(scenes) == 42
    assert {name.partition("_")[0] for name in scenes} == set(CAPTURES)
    subset = {"teapot": 1, "grogu": 2, "gnome": 3, "car": 4, "pitcher": 5, "blocks": 6, "cactus": 7}
    assert {f"{name}_scene{place:03}" for name, place in subset.items()} <= set(scenes)


@pytest.mark.parametrize("name", ["ng", "ns"])
def test_rows_of_one_knob_share_stage_one_and_nothing_else(name: str) -> None:
    cells = [cell for _, cell in asked(1, SUITES[name], "tiny").cells]
    assert len({cell.first_key for cell in cells}) == 1
    assert len({cell.training_key for cell in cells}) == len(cells)
    knob = {"ng": "consistency_surfels", "ns": "incident_samples"}[name]
    values = [getattr(cell.budget, knob) for cell in cells]
    assert values == sorted(values)
    assert getattr(PRESETS["tiny"], knob) in values
    assert getattr(PRESETS["paper"], knob) == PAPER_BUDGET[knob]


RELIT = ("relight_hemisphere_samples", "relight_light_samples")
KNOBS = {
    "ng": ("consistency_surfels",), "ns": ("incident_samples",), "mipnerf360-ng": ("consistency_surfels",),
    "mipnerf360-ns": ("incident_samples",), "efficiency": RELIT,
}  # fmt: skip


@pytest.mark.parametrize("name", KNOBS)
@pytest.mark.parametrize("preset", list(PRESETS))
def test_a_row_is_labelled_by_its_actual_numbers_under_every_preset(name: str, preset: str) -> None:
    request = asked(1, SUITES[name], preset)
    lines = {line["key"]: line for line in request.manifest()["rows"]}
    for place, cell in request.cells:
        if name == "efficiency" and not SUITES[name].rows[list(lines).index(place["row"])].budget:
            continue
        ran, paper = sum(getattr(cell.budget, field) for field in KNOBS[name]), place["row"].rpartition("-")[2]
        line = lines[place["row"]]
        assert f" = {ran} (paper: {paper})" in line["text"]
        assert f"={ran}$" in line["latex"]
        if preset == "paper":
            assert ran == int(paper), "beside the paper's row stands what the paper ran"


def test_numbers_that_a_row_changes_are_in_its_label() -> None:
    """But for rows that compare something else, and take more of the budget to do it, and numbers that are the same in
    all rows."""
    for each in SUITES.values():
        same = set.intersection(*(set(row.budget.items()) for row in each.rows))
        for row in (row for row in each.rows if row.budget and not row.settings):
            named = {name for found in NUMBER.findall(row.text) for name in found.split("+")}
            assert named == set(dict(row.budget.items() - same)), row.key


def test_a_label_that_names_no_number_of_the_budget_is_refused() -> None:
    wrong = replace(SUITES["ns"], rows=(Row("ns-64", "", "N_s = <incident_rays>"),))
    with pytest.raises(UsageError, match="names 'incident_rays'") as raised:
        asked(1, wrong).manifest()
    assert "incident_samples" in raised.value.why


def test_the_cost_is_measured_with_knobs_of_both_stages_and_of_relighting() -> None:
    """Under every preset, the smallest included: a knob trains no stage anew that does not read it."""
    stage_1 = {"geometry.steps", "geometry.initial_surfels", "geometry.maximum_surfels", "light_height"}
    stage_2 = {"inverse_iterations", "consistency_surfels", "incident_samples", "refresh_interval"}
    relighting = {"relight_hemisphere_samples", "relight_light_samples"}
    rows = {row.key: set(row.budget) for row in SUITES["cost"].rows}
    assert set.union(*rows.values()) == stage_1 | stage_2 | relighting
    turned = Counter(name for names in rows.values() if len(names) < 3 for name in names)
    assert set(turned) == stage_1 | stage_2 | relighting, "every knob is turned without the others"
    assert min(turned.values()) >= 2
    for preset in ("smoke", "tiny", "paper"):
        cells = {place["row"]: cell for place, cell in asked(1, SUITES["cost"], preset).cells}
        whole = cells.pop("reference")
        for row, cell in cells.items():
            assert (cell.first_key == whole.first_key) == (not rows[row] & stage_1), row
            assert (cell.training_key == whole.training_key) == (bool(rows[row]) and rows[row] <= relighting), row


def test_fine_tuning_for_longer_trains_nothing_anew() -> None:
    request = asked(1, SUITES["finetune"])
    cells = [cell for _, cell in request.cells]
    assert len({cell.training_key for cell in cells}) == 1
    assert len({cell.key for cell in cells}) == len(cells)


def test_a_preset_too_small_for_a_row_is_refused() -> None:
    with pytest.raises(UsageError, match="too small"):
        scaled(PRESETS["smoke"], {"incident_samples": 0.01})
    least = scaled(PRESETS["smoke"], {"incident_samples": 1 / PRESETS["smoke"].incident_samples})
    assert least.incident_samples == 1


def test_a_suite_of_other_methods_has_their_rows_and_one_for_each_that_has_none(chain: Chain) -> None:
    both = of_methods(ABLATIONS, ["radiogs", "chain"])
    assert both.rows[:-1] == ABLATIONS.rows
    assert (both.rows[-1].key, both.rows[-1].text, both.rows[-1].method) == ("chain", chain.title, "chain")
    assert both.reference == ABLATIONS.reference
    assert (both.columns, both.scenes, both.published) == (ABLATIONS.columns, ABLATIONS.scenes, ABLATIONS.published)
    alone = of_methods(ABLATIONS, ["chain"])
    assert [row.method for row in alone.rows] == ["chain"]
    assert alone.reference == "chain", "the reference row is gone: the first stands for it"
    own = replace(ABLATIONS, rows=(*ABLATIONS.rows, Row("turned", "T", "T", {"weight": 2.0}, method="chain")))
    assert [row.key for row in of_methods(own, ["chain"]).rows] == ["turned"], "a suite's own rows of it come first"


def test_a_method_from_a_file_has_a_row_whose_key_is_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its path is what it is found by, and no key in a table."""
    monkeypatch.setitem(substitutes, "folder/some method.toml", Chain(("fit",), name="some method"))
    (row,) = of_methods(ABLATIONS, ["folder/some method.toml"]).rows
    assert (row.key, row.method) == ("some-method", "folder/some method.toml")


def test_an_unknown_method_is_refused_with_the_nearest_name(chain: Chain) -> None:
    with pytest.raises(UsageError, match=r"unknown method 'chian'\nDid you mean 'chain'"):
        of_methods(ABLATIONS, ["chian"])


def test_a_field_is_set_in_every_row_that_has_it_and_does_not_set_it_itself(chain: Chain) -> None:
    rows = (
        Row("ours", "Ours", "Ours"),
        Row("chosen", "C", "C", {"effects": []}),
        Row("split-sum", "S", "S", {"shading": "split-sum"}),  # the method refuses a choice of effects with it
        Row("stranger", "X", "X", method="chain"),
    )
    suite = with_effects(replace(ABLATIONS, rows=rows, reference="ours"), "auto")
    assert [row.variant for row in suite.rows] == [{"effects": "auto"}, {"effects": []}, {"shading": "split-sum"}, {}]
    assert [row.text for row in suite.rows] == ["Ours (effects: auto)", "C", "S", "X"]
    assert suite.rows[0].latex == "Ours (auto)"
    assert [row.key for row in suite.rows] == [row.key for row in rows], "labels change, keys do not"


def test_no_row_is_turned_to_a_value_that_its_method_refuses() -> None:
    assert with_effects(ABLATIONS, ["sunshine"]) == ABLATIONS


def test_cells_of_several_methods_stand_in_one_request(chain: Chain) -> None:
    suite = of_methods(replace(ABLATIONS, rows=ABLATIONS.rows[:1]), ["radiogs", "chain"])
    cells = dict(zip(("ours", "chain"), (cell for _, cell in asked(1, suite).cells), strict=True))
    assert [cell.method for cell in cells.values()] == ["radiogs", "chain"]
    assert [stage.name for stage in cells["chain"].stages] == ["fit"]
    assert cells["chain"].budget == chain.presets["smoke"]
    with pytest.raises(UsageError, match="unknown preset 'paper' of chain"):
        asked(1, suite, "paper")


@pytest.mark.parametrize("name", ["ablations", "departures", "rivals", "cost", "baselines", "length", "closed"])
def test_suites_run_where_nothing_was_tuned_and_half_of_their_scenes_or_more_are_by_other_hands(name: str) -> None:
    scenes = SUITES[name].scenes
    assert {scene_choices(scene) for scene in scenes} == {"reported only"}
    assert 2 * len({*scenes} & {*scene_names(OTHERS)}) >= len(scenes)
    assert len({scene_kind(scene) for scene in scenes}) == len(scenes)


def test_closed_has_pairs_that_differ_in_l_rad_alone_under_four_lights() -> None:
    pairs = list(zip(CLOSED.rows[::2], CLOSED.rows[1::2], strict=True))
    for ours, without in pairs:
        assert ({**ours.variant, "radiometric_weight": 0.0}, ours.given) == (without.variant, without.given)
    assert len({(*sorted(map(str, ours.variant.items())), ours.given) for ours, _ in pairs}) == 4


def test_the_ablations_have_the_most_indirect_light_first() -> None:
    share = [
        json.loads((scene_folder(name) / "metadata.json").read_text())["indirect_share"]
        for name in SUITES["ablations"].scenes
    ]
    assert share == sorted(share, reverse=True)


def test_some_rows_of_a_suite_keep_its_order_and_its_reference_row_if_it_is_among_them() -> None:
    both = with_rows(SUITES["ablations"], ["no-rad", "ours"])
    assert [row.key for row in both.rows] == ["ours", "no-rad"]
    assert both.reference == "ours"
    assert with_rows(SUITES["ablations"], ["no-rad", "nvs-init"]).reference == "no-rad"
    with pytest.raises(UsageError, match="unknown row 'no-red' of suite 'ablations'\nDid you mean 'no-rad'"):
        with_rows(SUITES["ablations"], ["no-red"])


def values_of(row: Row) -> dict[str, object]:
    """The variant of a row by dotted names."""
    return flat(to_plain(variant_by_recipe(method(row.method), row.recipe, "blender", "corner", row.variant)))


def test_departures_begin_as_printed_and_end_as_recommended() -> None:
    assert values_of(DEPARTURES.rows[0]) == values_of(Row("printed", "", "", recipe="printed"))
    assert values_of(DEPARTURES.rows[-1]) == flat(to_plain(Variant()))
    assert not RECIPES["recommended"].values


def test_every_departure_is_in_one_group() -> None:
    groups = [set(values) for _, values in DEPARTURE_GROUPS.values()]
    assert not any(one & other for one, other in combinations(groups, 2))
    assert set().union(*groups) == set(PRINTED)
    assert len(groups) <= 10


def test_rivals_and_lengths_have_every_setting_with_and_without_l_rad() -> None:
    for each in (RIVALS, CONSISTENCY_LENGTH):
        by_others: dict[str, set[object]] = {}
        for row in each.rows:
            values = values_of(row)
            weight = values.pop("radiometric_weight")
            by_others.setdefault(repr([values, row.budget]), set()).add(weight)
        alone = [weights for weights in by_others.values() if weights != {0.0, 0.2}]
        assert alone == ([{0.2}] * 2 if each is RIVALS else [])


def test_a_row_whose_light_is_sought_has_no_other_light_in_its_place() -> None:
    for row in RIVALS.rows:
        values = values_of(row)
        deviations = values["deviations"]
        assert isinstance(deviations, list)
        sought = values["materials.start.light"] != "constant"
        assert not (sought and "start-light" in deviations), row.key
        assert sought == ("constant" not in row.text and (row.recipe != "printed" or "sought" in row.text))


def test_light_alone_differs_between_printed_and_a_light_that_is_sought() -> None:
    rows = {row.key: values_of(row) for row in RIVALS.rows}
    for key in ("printed-held", "printed-learnt"):
        changed = {name for name, value in rows[key].items() if value != rows["printed"][name]}
        assert changed <= {"materials.start.light", "deviations", "materials.rates.light"}
        left = set(rows["printed"]["deviations"]) - set(rows[key]["deviations"])  # type: ignore[call-overload]
        assert left == {"start-light"}


def cells_with(values: dict[str, list[float | None]], monkeypatch: pytest.MonkeyPatch) -> list[CellRef]:
    """Cells of one row by scene and seed, whose results have these PSNRs of new views."""
    results: dict[str, Any] = {
        f"{scene} {seed}": {"metrics": {"nvs/psnr": {"value": value}}}
        for scene, each in values.items()
        for seed, value in enumerate(each)
    }
    monkeypatch.setattr(Store, "result", lambda self, key: results.get(key))
    keys = [*results, "unfinished 0"]
    return [CellRef(row="ours", scene=key.split()[0], seed=int(key.split()[1]), key=key, stages=[]) for key in keys]


def test_the_suite_has_the_miniature_and_every_condition() -> None:
    assert HARD_TRAINING.scenes == (BASE, *CONDITIONS)
    assert set(SAME) == {"hard-scale-1e-4", "hard-scale-1e4", "hard-distance-1e3"}


def test_a_change_is_the_mean_over_shared_seeds_and_other_conditions_may_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = cells_with({BASE: [30.0, 31.0], SAME[0]: [31.5, 30.1, 99.0], "hard-black": [3.0, 3.0]}, monkeypatch)
    said = invariance_kept(Store(tmp_path), cells)
    assert f"ours, {SAME[0]}, nvs/psnr +0.30 dB." in said
    assert "hard-black" not in said


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_change_beyond_its_tolerance_fails_with_the_condition_and_the_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sign: int
) -> None:
    moved = 30.0 + sign * (TOLERANCES["nvs/psnr"] + 0.01)
    cells = cells_with({BASE: [30.0], SAME[1]: [moved], SAME[2]: [30.0]}, monkeypatch)
    with pytest.raises(NumericalFailure, match="1 of 2 metrics change") as caught:
        invariance_kept(Store(tmp_path), cells)
    assert f"ours, {SAME[1]}, nvs/psnr {moved - 30:+.2f} dB." in caught.value.why


def test_without_the_miniature_itself_there_is_no_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = cells_with({SAME[0]: [30.0], BASE: [None]}, monkeypatch)
    assert "Invariance was not measured" in invariance_kept(Store(tmp_path), cells)


def test_guards_are_counted_and_neither_ranked_nor_better_or_worse() -> None:
    from radiogs_bench.results.summary import column_summary
    from radiogs_bench.suites.suite import Metric
    from radiogs_reports.analysis.comparisons import ranks, to_reference
    from radiogs_reports.statistics import Origin

    column = column_summary(Metric("guards", "fired"))
    assert column["direction"] == "none"
    samples = {
        row: {Origin("s", seed, ""): first + seed for seed in range(4)} for row, first in (("a", 1.0), ("b", 9.0))
    }
    assert ranks(samples, "none") == {}
    assert ranks(samples, "down") == {"a": 1, "b": 2}
    assert to_reference(samples, "a", "none")["b"].verdict is None
