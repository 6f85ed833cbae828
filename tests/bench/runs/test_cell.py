"""A cell's keys change with everything that its product depends on, and with nothing else."""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from bench.chain_method import Chain, Steps, Turned
from bench.fake_method import FAKE, SCENE, fake_cell
from radiogs.method import RADIOGS
from radiogs.settings import DEVIATIONS, INVERSE_ONLY, PRESETS, Budget, Variant
from radiogs_bench.runs.cell import Cell, Work, cell_of, evaluation_code
from radiogs_bench.store.keys import content_key
from radiogs_bench.suites.experiment import COST, EXPERIMENTS, FORWARD_PARITY, TRAINING
from radiogs_bench.suites.paper import ABLATIONS
from radiogs_core.contract import StageSpec, values_of
from radiogs_core.plain_values import flat, with_values

OTHER_VALUES: Mapping[str, Any] = {
    "radiometric_weight": 0.1,
    "detach": "pbr",
    "initialise": "nvs",
    "view_share": 0.5,
    "shading": "split-sum",
    "incident": "detached",
    "relighting": "surfels",
    "met_light": "unoccluded",
    "deviations": tuple(DEVIATIONS),
    "ray_offset": 0.1,
    "masking": "height-correlated",
    "effects": "auto",
    "given": ("light",),
    "geometry": replace(Variant().geometry, weights=replace(Variant().geometry.weights, normal=0.1)),
    "split_sum": replace(Variant().split_sum, consistency=0.1),
    "materials": replace(Variant().materials, weights=replace(Variant().materials.weights, mask=0.1)),
    "finetuning": replace(Variant().finetuning, degree_0=0.1),
}
"""Another value of every field of the variant than the full method has."""

FROM_STAGE_1 = ("initialise", "view_share", "deviations", "geometry", "split_sum", "masking")
SHOWING_ALONE = ("relighting", "met_light", "finetuning")


def radiogs_cell(variant: Variant | None = None, budget: Budget | None = None, **work: Any) -> Cell:
    """A cell of the method itself."""
    return cell_of(RADIOGS, SCENE, Work(variant or Variant(), budget or PRESETS["smoke"], **work))


def changed(cell: Cell, like: Cell) -> list[bool]:
    """Which keys differ: one for each stage, then the result's."""
    stages = [mine.key != theirs.key for mine, theirs in zip(cell.stages, like.stages, strict=True)]
    return [*stages, cell.key != like.key]


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Variant)])
def test_a_field_of_the_variant_changes_the_first_stage_that_reads_it_and_all_after(name: str) -> None:
    first = 0 if name in FROM_STAGE_1 else 2 if name in SHOWING_ALONE else 1
    found = changed(radiogs_cell(Variant(**{name: OTHER_VALUES[name]})), radiogs_cell())
    assert found == [place >= first for place in range(3)]


@pytest.mark.parametrize("name", flat(dataclasses.asdict(PRESETS["smoke"])))
def test_a_field_of_the_budget_changes_the_first_stage_that_reads_it_and_all_after(name: str) -> None:
    """Its name alone is that of no stage's work: a preset under another name trains the same."""
    first = 2 if name in ("name", *Budget.shown_only) else 1 if name in INVERSE_ONLY else 0
    smoke = PRESETS["smoke"]
    value = "other" if name == "name" else 2 * flat(dataclasses.asdict(smoke))[name]
    found = changed(radiogs_cell(budget=with_values(smoke, {name: value})), radiogs_cell())
    assert found == [place >= first for place in range(3)]


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Variant)])
def test_the_start_of_stage_2_is_shared_by_variants_that_differ_in_what_it_does_not_read(name: str) -> None:
    start = radiogs_cell(Variant(**{name: OTHER_VALUES[name]})).stages[1].start
    assert (start != radiogs_cell().stages[1].start) == (name in (*FROM_STAGE_1, "shading", "effects"))


def test_the_ablations_of_radiometric_consistency_share_the_start_of_stage_2_but_for_the_other_stage_1() -> None:
    rows = {row.key: radiogs_cell(Variant(**row.variant)).stages[1].start for row in ABLATIONS.rows}
    assert [key for key, start in rows.items() if start != rows["ours"]] == ["nvs-init"]


def test_deviations_that_stage_1_does_not_make_leave_it_shared() -> None:
    later = next(
        name for name in DEVIATIONS if name not in Variant(deviations=(name,)).of_initialisation()["deviations"]
    )
    assert changed(radiogs_cell(Variant(deviations=(later,))), radiogs_cell()) == [False, True, True]


@pytest.mark.parametrize(
    "other",
    [
        fake_cell(scene=replace(SCENE, checksum="1" * 64)),
        fake_cell(scene=replace(SCENE, loaders=("radiogs_core.errors",))),
        fake_cell(seed=1),
        fake_cell(device="cuda"),
    ],
    ids=["scene", "loader", "seed", "device"],
)
def test_every_key_depends_on_scene_loader_seed_and_device(other: Cell) -> None:
    assert changed(other, fake_cell()) == [True, True, True]


@dataclass(frozen=True)
class Differently:
    """The fake with something else in the stages from ``place`` on, or in how it is shown."""

    place: int = 0
    change: tuple[tuple[str, Any], ...] = ()
    sources: tuple[str, ...] = FAKE.sources

    name = FAKE.name
    title = FAKE.title
    variant = FAKE.variant
    presets = FAKE.presets
    restore = FAKE.restore

    def stages(self, variant: Variant, budget: Budget) -> Sequence[StageSpec]:
        specs = list(FAKE.stages(variant, budget))
        specs[self.place] = replace(specs[self.place], **dict(self.change))
        return specs


def differently(*given: Any, **named: Any) -> Cell:
    return cell_of(Differently(*given, **named), SCENE, Work(Variant(), PRESETS["smoke"]))


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize(
    "change",
    [("owner", "another"), ("name", "another"), ("reads", {"other": 1}), ("sources", ("radiogs_core.scene.camera",))],
)
def test_owner_name_dependencies_and_sources_of_a_stage_change_it_and_all_after(place: int, change: Any) -> None:
    assert changed(differently(place, (change,)), fake_cell()) == [stage >= place for stage in range(3)]


@pytest.mark.parametrize("change", [("title", "another"), ("steps", 99), ("compiles", False)])
def test_the_title_of_a_stage_changes_no_key(change: Any) -> None:
    """Steps are among what it reads if they decide its outcome."""
    assert changed(differently(0, (change,)), fake_cell()) == [False] * 3


def test_sources_of_showing_change_the_result_and_train_nothing_anew() -> None:
    found = differently(sources=("radiogs.relighting",))
    assert changed(found, fake_cell()) == [False, False, True]
    assert found.evaluation_code != fake_cell().evaluation_code
    assert found.method_code != fake_cell().method_code


class Siblings(Chain):
    """A chain whose first stages are those of another method."""

    def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
        first, *rest = super().stages(variant, budget)
        return [replace(first, owner="elder"), *rest]


def test_methods_that_name_one_owner_share_a_stage_and_no_more() -> None:
    work = Work(Turned(), Chain.presets["smoke"])
    elder = cell_of(Chain(("begin", "end"), name="elder"), SCENE, work)
    younger = cell_of(Siblings(("begin", "end"), name="younger"), SCENE, work)
    assert changed(younger, elder) == [False, True, True]


def test_a_field_that_only_rendering_reads_changes_the_result_and_no_stage() -> None:
    chain = Chain(("one", "two", "three"))
    cells = [cell_of(chain, SCENE, Work(Turned(shown=shown), chain.presets["smoke"])) for shown in (1.0, 2.0)]
    assert changed(*cells) == [False, False, False, True]


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_stages_are_chained_and_the_first_and_last_of_them_name_what_is_shared(count: int) -> None:
    """Stages that read and do the same are still different products, one after the other."""

    class Alike(Chain):
        def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
            return [
                replace(spec, name="again", reads=values_of(variant, "weight"))
                for spec in super().stages(variant, budget)
            ]

    cell = cell_of(Alike([f"s{place}" for place in range(count)]), SCENE, Work(Turned(), Alike.presets["smoke"]))
    keys = [stage.key for stage in cell.stages]
    assert len({*keys, cell.key}) == count + 1
    assert (cell.first_key, cell.training_key) == (keys[0], keys[-1])


def test_an_experiment_that_trains_nothing_has_no_stages_and_is_its_own_first() -> None:
    cell = fake_cell(experiment=FORWARD_PARITY, settings={"spacing": 0.1})
    assert cell.stages == ()
    assert cell.training_key is None
    assert cell.first_key == cell.key
    assert cell.key != fake_cell(experiment=FORWARD_PARITY, settings={"spacing": 0.2}).key


def test_another_protocol_keeps_the_trained_model() -> None:
    assert changed(fake_cell(protocol="irgs"), fake_cell()) == [False, False, True]


def test_other_sources_that_score_keep_the_trained_model() -> None:
    other = replace(fake_cell(), evaluation_code="other")
    assert changed(other, fake_cell()) == [False, False, True]


def test_scores_along_the_way_are_part_of_what_the_last_stage_leaves() -> None:
    assert changed(fake_cell(experiment=COST), fake_cell()) == [False, True, True]
    assert changed(fake_cell(experiment=COST, protocol="irgs"), fake_cell(experiment=COST)) == [False, True, True]


def test_the_scene_counts_by_its_content_not_by_its_name() -> None:
    assert changed(fake_cell(scene=replace(SCENE, name="elsewhere/corner")), fake_cell()) == [False] * 3


def test_the_key_depends_on_the_method_and_not_on_its_path() -> None:
    work = Work(Variant(), PRESETS["smoke"])
    found = cell_of(FAKE, SCENE, work, "somewhere/fake.toml")
    assert found.found_as == "somewhere/fake.toml"
    assert changed(found, fake_cell()) == [False] * 3


def test_every_field_of_the_variant_is_in_the_content() -> None:
    assert fake_cell().content()["variant"].keys() == {field.name for field in dataclasses.fields(Variant)}


@pytest.mark.parametrize("variant", [Variant(deviations=tuple(DEVIATIONS)), Variant(effects=("visibility",))])
def test_the_content_is_what_a_stored_result_gives_back(variant: Variant) -> None:
    """Else nothing that is looked for by its content is ever found in a store."""
    content = fake_cell(variant=variant).content()
    assert json.loads(json.dumps(content)) == content


def test_tuples_of_a_strangers_budget_are_lists_in_the_content() -> None:
    content = cell_of(Chain(("fit",)), SCENE, Work(Turned(), Chain.presets["smoke"])).content()
    assert content["budget"] == {"name": "smoke", "each": 3, "sizes": [8, 4]}
    assert json.loads(json.dumps(content)) == content


def test_keys_are_the_same_in_every_process_and_forever() -> None:
    """A literal: if this fails, every store in the world is out of date, and the schema's version must rise."""
    content = {"b": [1, 2.5, None, True], "a": {"text": "Ä"}}
    # printf '%s' '{"a":{"text":"\\u00c4"},"b":[1,2.5,null,true]}' | sha256sum
    assert content_key(content) == "edea64a45ce29f8f2855"


def test_content_that_is_no_json_has_no_key() -> None:
    with pytest.raises(ValueError, match="Out of range"):
        content_key({"value": float("inf")})


def test_results_without_lpips_are_scored_again_once_its_weights_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    without = evaluation_code(EXPERIMENTS[TRAINING], FAKE)
    (tmp_path / "alexnet_features.npz").touch()
    (tmp_path / "alex.pth").touch()
    assert evaluation_code(EXPERIMENTS[TRAINING], FAKE) != without
