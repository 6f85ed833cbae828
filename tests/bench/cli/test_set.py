"""``--set``: any field of a variant or a budget by its dotted name, in runs, trainings and from Python."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

import radiogs_bench as rb
from bench import fake_method
from bench.chain_method import Chain
from bench.fake_method import FakeSweep, asked
from radiogs.settings import PRESETS, Variant
from radiogs_bench.cli.main import main
from radiogs_bench.cli.values import setting
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.methods import budget_of, method, settable, settings_of
from radiogs_bench.results.paper_tables import paper_tables
from radiogs_bench.runs.rows import with_settings
from radiogs_bench.runs.sweep import read_sweep, shown_preset
from radiogs_bench.runs.trained_folder import read_about, read_trained
from radiogs_bench.suites.paper import ABLATIONS, NS
from radiogs_bench.suites.suite import Row, with_numbers
from radiogs_core.errors import UsageError

FakeRun = Callable[..., int]


@dataclass(frozen=True)
class Rates:
    light: float = 0.5
    steps: int = 2


@dataclass(frozen=True)
class Nested:
    geometry: Rates = field(default_factory=Rates)
    share: float = 1.0


@dataclass(frozen=True)
class NestedBudget:
    name: str
    geometry: Rates = field(default_factory=Rates)
    each: int = 3


class NestedChain(Chain):
    """A method whose variant and budget both have a field ``geometry.light``."""

    variant = Nested  # type: ignore[assignment]
    presets: Mapping[str, Any] = {"smoke": NestedBudget("smoke")}


CHAIN = NestedChain(("fit",))


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("inverse_iterations=300", ("inverse_iterations", 300)),
        ("materials.rates.light = 0.01", ("materials.rates.light", 0.01)),
        ("effects=auto", ("effects", "auto")),
        ('effects=["visibility"]', ("effects", ["visibility"])),
        ("two_sided=false", ("two_sided", False)),
        ("detach=split-sum", ("detach", "split-sum")),
        ('path="a=b c"', ("path", "a=b c")),
    ],
)
def test_a_setting_is_toml_or_a_bare_word(text: str, read: tuple[str, Any]) -> None:
    assert setting(text) == read
    assert type(setting(text)[1]) is type(read[1])


@pytest.mark.parametrize("text", ["steps", "=3", "a..b=3", "a b=3", "a=", "a=two words", "a=[1", "a=1\nb=2"])
def test_a_setting_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"of a|FIELD=VALUE"):
        setting(text)


def test_a_field_is_resolved_in_the_variant_or_in_the_budget() -> None:
    found = settings_of(CHAIN, "smoke", {"share": 0.5, "each": 4, "absent": 0, "budget.geometry.light": 0.1})
    assert found.variant == {"share": 0.5}
    assert found.budget == {"each": 4, "geometry.light": 0.1}


def test_a_field_of_both_has_to_be_named_in_full() -> None:
    with pytest.raises(UsageError, match=r"both the variant and the budget of chain .*'geometry.light'") as caught:
        settings_of(CHAIN, "smoke", {"geometry.light": 0.1})
    assert caught.value.remedy == "Write variant.geometry.light or budget.geometry.light."
    assert settings_of(CHAIN, "smoke", {"variant.geometry.light": 0.1}).variant == {"geometry.light": 0.1}


@pytest.mark.parametrize(
    "given", [{"share": 0.5, "variant.share": 0.6}, {"budget.each": 4, "each": 5}, {"each": 4, "budget.each": 4}]
)
def test_a_field_is_not_set_twice_by_its_short_and_its_full_name(given: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="of chain is set twice"):
        settings_of(CHAIN, "smoke", given)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"geometry": {"steps": 7}, "geometry.steps": 8}, "geometry.steps is given twice"),
        ({"each": {}}, "each: {} is not a whole number"),
    ],
)
def test_a_table_in_a_budget_is_neither_lost_nor_given_twice(given: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        budget_of(CHAIN, "smoke", given)


def test_a_dry_run_names_the_fields_that_are_set(fake_run: FakeRun, capsys: pytest.CaptureFixture[str]) -> None:
    assert fake_run("ablations", "--dry-run", "--set", "inverse_iterations=7") == 0
    assert "preset smoke with inverse_iterations = 7" in capsys.readouterr().out


def test_a_method_is_shown_with_the_names_that_can_be_set(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["methods", "radiogs"]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in settable(method("radiogs"), "smoke"))


def test_the_name_of_a_changed_budget_lists_the_changes() -> None:
    budget = budget_of(CHAIN, "smoke", {"geometry": {"steps": 7}, "each": 4})
    assert budget == NestedBudget("smoke, each = 4, geometry.steps = 7", Rates(steps=7), 4)
    assert budget_of(CHAIN, "smoke", {"each": 3}) == CHAIN.presets["smoke"], "nothing is changed"
    assert with_numbers("<geometry.steps> of <each+geometry.steps>", {"each": 4, "geometry": {"steps": 7}}) == "7 of 11"


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"inverse_iterations": 0}, "inverse_iterations: 0 is not between 1 and 2147483647"),
        ({"inverse_iterations": 2**31}, "is not between 1"),
        ({"inverse_iterations": 1.5}, "inverse_iterations: 1.5 is not a whole number"),
        ({"geometry.rate": -1}, "geometry.rate: -1.0 is not between 0"),
        ({"inverse_iteration": 3}, "Did you mean 'inverse_iterations'?"),
        ({"name": "paper"}, "the name of a budget cannot be set"),
    ],
)
def test_a_number_that_is_no_amount_of_work_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError) as caught:
        budget_of(method("radiogs"), "smoke", given)
    assert says in str(caught.value)


def test_every_row_gets_the_fields_that_it_does_not_set_itself() -> None:
    given = {"radiometric_weight": 0.1, "materials.rates.light": 0.5, "inverse_iterations": 7}
    suite, remarks = with_settings(ABLATIONS, given, "smoke")
    assert remarks == ["row 'no-rad' sets radiometric_weight itself and keeps its value"]
    rows = {row.key: row for row in suite.rows}
    assert rows["ours"].variant == {"radiometric_weight": 0.1, "materials.rates.light": 0.5}
    assert rows["no-rad"].variant == {"radiometric_weight": 0.0, "materials.rates.light": 0.5}
    ours, no_rad = ABLATIONS.rows[0], ABLATIONS.rows[1]
    marks = "inverse_iterations = 7, materials.rates.light = 0.5"
    assert rows["ours"].text == f"{ours.text} ({marks}, radiometric_weight = 0.1)"
    assert rows["no-rad"].text == f"{no_rad.text} ({marks})"
    assert not rows["ours"].latex, "reports escape the text"


def test_a_row_that_refuses_a_value_is_named_and_left() -> None:
    rows = (Row("ours", "Ours", "Ours"), Row("split-sum", "S", "S", {"shading": "split-sum"}))
    suite, remarks = with_settings(replace(ABLATIONS, rows=rows), {"effects": "auto"}, "smoke")
    assert suite.rows[0].variant == {"effects": "auto"}
    assert suite.rows[1] == rows[1]
    assert remarks == [
        "row 'split-sum' keeps its variant: variant of radiogs: a choice of effects for split-sum shading"
    ]


def test_rows_of_methods_without_the_field_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(substitutes, "chain", CHAIN)
    rows = (Row("ours", "Ours", "Ours"), Row("stranger", "X", "X", method="chain"))
    suite, remarks = with_settings(replace(ABLATIONS, rows=rows), {"view_share": 0.5}, "smoke")
    assert [row.variant for row in suite.rows] == [{"view_share": 0.5}, {}]
    assert suite.rows[1] == rows[1]
    assert remarks == ["rows of method 'chain' run as they are: it has none of the fields that are set"]


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"view_shar": 0.5}, "unknown field 'view_shar'\nDid you mean 'view_share'?"),
        ({"light": 0.5}, "Did you mean 'split_sum.light' or 'materials.rates.light' or 'materials.start.light'?"),
        ({"view_share": "half"}, "variant of radiogs: view_share: 'half' is not a number"),
        ({"view_share": 2.0}, "view_share: 2.0 is not above 0 and at most 1"),
        ({"detach": "pbrr"}, "detach: 'pbrr' is none of its values"),
        ({"materials": 3}, "unknown field 'materials'"),
    ],
)
def test_a_field_that_no_method_has_and_a_value_that_it_does_not_take_are_errors(
    given: dict[str, Any], says: str
) -> None:
    with pytest.raises(UsageError) as caught:
        with_settings(ABLATIONS, given, "smoke")
    assert says in str(caught.value)


def test_factors_of_a_row_multiply_the_number_that_is_set() -> None:
    suite, _ = with_settings(NS, {"incident_samples": 16}, "smoke")
    request = asked(1, suite, settings={"incident_samples": 16})
    samples = {place["row"]: cell.budget.incident_samples for place, cell in request.cells}
    assert samples == {row.key: round(16 * row.budget["incident_samples"]) for row in NS.rows}
    manifest = request.manifest()
    assert (manifest["preset"], manifest["marks"]) == ("smoke", "incident_samples = 16")
    half = next(row for row in NS.rows if row.budget["incident_samples"] == 0.5)
    (line,) = [line for line in manifest["rows"] if line["key"] == half.key]
    assert line["text"].startswith("N_s = 8 (paper: 32)")
    assert line["text"].endswith("(incident_samples = 16)")
    names = {cell.budget.name for place, cell in request.cells if place["row"] == half.key}
    assert names == {"smoke, incident_samples = 16, consistency_surfels x 0.5, incident_samples x 0.5"}


@pytest.mark.slow
def test_a_run_with_a_set_field_has_cells_labels_and_reports_of_its_own(
    fake_run: FakeRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fake_run("ablations") == 0
    plain = read_sweep(tmp_path)
    capsys.readouterr()
    assert fake_run("ablations", "--set", "radiometric_weight=0.1", "--set", "inverse_iterations=7") == 0
    printed = capsys.readouterr()
    assert "row 'no-rad' sets radiometric_weight itself and keeps its value" in printed.out
    changed, summary = read_sweep(tmp_path), json.loads((tmp_path / "summary.json").read_text())
    assert not {cell["key"] for cell in plain["cells"]} & {cell["key"] for cell in changed["cells"]}
    assert summary["preset"] == shown_preset(changed) == "smoke with inverse_iterations = 7, radiometric_weight = 0.1"
    assert all("inverse_iterations = 7" in row["text"] for row in summary["rows"])
    assert [row["key"] for row in summary["rows"] if "radiometric_weight" in row["text"]] == [
        row.key for row in ABLATIONS.rows if "radiometric_weight" not in row.variant
    ]
    assert {run["made_from"]["budget"]["name"] for run in summary["runs"]} == {"smoke, inverse_iterations = 7"}
    assert (tmp_path / "earlier" / "ablations-smoke-default-cpu" / "report.tex").is_file()
    assert fake_run("ablations") == 0, "the first run again"
    kept = [path.name for path in (tmp_path / "earlier").iterdir()]
    assert any(name.startswith("ablations-smoke-with-inverse_iterations-7-radiometric_weight-0.1") for name in kept)


def test_a_run_refuses_a_field_that_is_set_twice(fake_run: FakeRun, capsys: pytest.CaptureFixture[str]) -> None:
    assert fake_run("ablations", "--set", "view_share=0.5", "--set", "view_share=1") == 2
    assert "'view_share' is set twice" in capsys.readouterr().err
    for name in ("effects", "variant.effects"):
        assert fake_run("ablations", "--effects", "auto", "--set", f"{name}=all") == 2
        assert "'effects' is set twice" in capsys.readouterr().err


def test_a_row_whose_variant_is_changed_has_not_the_papers_label(tmp_path: Path) -> None:
    """Scenes, images and budget could be the paper's all the same."""
    sweep = FakeSweep(tmp_path)
    suite, _ = with_settings(ABLATIONS, {"view_share": 0.5, "inverse_iterations": 7}, "smoke")
    request = asked(1, suite, settings={"view_share": 0.5, "inverse_iterations": 7})
    sweep.run([cell for _, cell in request.cells])
    (table,) = paper_tables(sweep.store, request.manifest())
    ran = {row["key"]: row["ran"] for row in table["rows"]}
    assert "view_share = 0.5; preset smoke, inverse_iterations = 7, N_g" in ran["ours"]


@pytest.mark.slow
def test_a_training_with_set_fields_is_opened_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(substitutes, fake_method.FAKE.name, fake_method.FAKE)
    arguments = ["train", "convex", "--preset", "smoke", "--no-score", "--out", str(tmp_path / "shell")]
    fields = ["--set", "finetune_iterations=3", "--set", "materials.rates.light=0.25"]
    assert main([*arguments, *fields]) == 0
    about = read_about(tmp_path / "shell")
    assert (about["preset"], about.get("budget")) == ("smoke", {"finetune_iterations": 3})
    run, _ = read_trained(tmp_path / "shell", fake_method.CPU, {"relighting": "surfels", "materials.rates.light": 0.5})
    assert run.budget == replace(PRESETS["smoke"], name="smoke, finetune_iterations = 3", finetune_iterations=3)
    assert run.variant.materials.rates.light == 0.5
    rb.train(
        "radiogs", "convex", preset="smoke", out=tmp_path / "python", budget={"finetune_iterations": 3},
        variant={"materials.rates.light": 0.25},
    )  # fmt: skip
    assert read_about(tmp_path / "python") == about
    capsys.readouterr()
    assert main([*arguments, "--seed", "1"]) == 2
    assert "preset smoke with finetune_iterations = 3, seed 0" in capsys.readouterr().err
    assert main([*arguments, "--set", "finetune_iteration=3"]) == 2
    assert "unknown field 'finetune_iteration' of radiogs" in capsys.readouterr().err
    assert Variant().materials.rates.light != 0.25
