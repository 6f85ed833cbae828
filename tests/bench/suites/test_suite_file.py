"""A user's suite is read like the package's suites, and errors in it are reported with their place."""

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.chain_method import Chain, Turned
from bench.fake_method import asked
from bench.own_suite import WHOLE
from radiogs.method import RADIOGS
from radiogs.settings import PRESETS
from radiogs_baselines.methods.irgs.method import IRGS_METHOD
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.suites.own import EFFECTS_SUITE
from radiogs_bench.suites.registry import read_suite
from radiogs_bench.suites.suite import Metric, Row, Suite, with_numbers
from radiogs_core.contract import scaled
from radiogs_core.errors import DataError, UsageError
from radiogs_core.plain_values import value_at

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "docs" / "examples" / "rays_or_surfels.toml"
GAIN = ROOT / "docs" / "examples" / "auto_beside_everything.toml"


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str], Suite]:
    def reading(content: str) -> Suite:
        file = tmp_path / "suite.toml"
        file.write_text(content)
        return read_suite(file)

    return reading


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("initialise_iterations", "geometry.steps"),
        ("initial_surfels", "geometry.initial_surfels"),
        ("maximum_surfels", "geometry.maximum_surfels"),
        ("densify_interval", "geometry.densify_interval"),
    ],
)
@pytest.mark.parametrize("method", ["radiogs", "irgs"])
def test_a_row_may_multiply_a_number_of_stage_1_by_its_former_name_with_a_warning(
    read: Callable[[str], Suite], old: str, new: str, method: str
) -> None:
    def of_row(name: str) -> Suite:
        row = f'[[rows]]\nkey = "a"\ntext = "A"\nmethod = "{method}"\nbudget = {{ {name} = 0.5 }}\n'
        return read(f'name = "mine"\ntitle = "Mine"\ncolumns = ["nvs/psnr"]\nreference = "a"\n{row}')

    small = RADIOGS.presets["small"] if method == "radiogs" else IRGS_METHOD.presets["small"]
    with pytest.warns(FutureWarning, match=f"'{old}' of a budget is called '{new}' now"):
        former = scaled(small, of_row(old).rows[0].budget)
    assert former == scaled(small, of_row(new).rows[0].budget)
    assert value_at(former, new) == value_at(small, new) // 2
    assert former.name == f"small, {new} x 0.5"


def test_a_label_may_name_a_number_of_stage_1_by_its_former_name_with_a_warning(read: Callable[[str], Suite]) -> None:
    row = '[[rows]]\nkey = "a"\ntext = "<initialise_iterations+inverse_iterations> steps"\n'
    with pytest.warns(FutureWarning, match="'initialise_iterations' of a budget is called 'geometry.steps' now"):
        suite = read(f'name = "mine"\ntitle = "Mine"\ncolumns = ["nvs/psnr"]\nreference = "a"\n{row}')
    with pytest.warns(FutureWarning, match="called 'geometry.steps' now"):
        assert with_numbers(suite.rows[0].text, PRESETS["smoke"]) == "80 steps"


@pytest.mark.filterwarnings("ignore:.*of a budget is called:FutureWarning")
def test_a_number_is_not_multiplied_by_its_former_and_its_present_name(read: Callable[[str], Suite]) -> None:
    row = '[[rows]]\nkey = "a"\ntext = "A"\nbudget = { initialise_iterations = 0.5, "geometry.steps" = 0.25 }\n'
    with pytest.raises(UsageError, match=r"'initialise_iterations' and 'geometry\.steps' are the same field"):
        read(f'name = "mine"\ntitle = "Mine"\ncolumns = ["nvs/psnr"]\nreference = "a"\n{row}')


def test_every_field_arrives(read: Callable[[str], Suite], tmp_path: Path) -> None:
    assert read(WHOLE) == Suite(
        name="mine",
        title="Mine & yours",
        published="ablation",
        reference="a",
        rows=(
            Row("a", "", "50 % of #1"),
            Row(
                "b", "$b$", "b", {"radiometric_weight": 1, "detach": "pbr", "view_share": 0.5},
                {"incident_samples": 0.5}, {"spacing": 0.1},
            ),
        ),
        columns=(Metric("nvs", "psnr"), Metric("normal", "mae")),
        scenes=("corner", str(tmp_path / "elsewhere" / "scene")),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("title =", "titel =", r"suite: there is no field 'titel'\nDid you mean 'title'"),
        ('text = "b"', 'txt = "b"', r"suite.rows\[1\]: there is no field 'txt'\nDid you mean 'text'"),
        ('title = "Mine & yours"', "", "it lacks 'title'"),
        ('text = "50 % of #1"', "", r"suite.rows\[0\]: it lacks 'text'"),
        ('title = "Mine & yours"', "title = 3", "suite.title: 3 is not text"),
        ("detach =", "detatch =", r"suite.rows\[1\].variant: there is no field 'detatch'\nDid you mean 'detach'"),
        ('"pbr"', '"brdf"', r"variant.detach: 'brdf' is none of its values\nThere are: 'none', 'pbr', 'surfel'"),
        ('"$b$"', "'\\input{/etc/hostname}'", r"rows\[1\].latex: .*input.* is not text with formulas between dollars"),
        ("weight = 1", "weight = true", "radiometric_weight: True is not a number"),
        ("weight = 1", "weight = nan", "radiometric_weight: nan is not a finite number"),
        ("weight = 1", "weight = -1", "radiometric_weight: -1.0 is not zero or above"),
        ("view_share = 0.5", "view_share = 1.5", "view_share: 1.5 is not above 0 and at most 1"),
        ("incident_samples", "incident_sample", "budget: there is no field .*Did you mean 'incident_samples'"),
        ("incident_samples = 0.5", "incident_samples = 0", "incident_samples: 0.0 is not above zero"),
        ("incident_samples = 0.5", "incident_samples = 1e30", "incident_samples: 1e[+]30 is not above zero and up to"),
        ("incident_samples = 0.5", "incident_samples = inf", "incident_samples"),
        ("incident_samples", '"geometry.rate"', "there is no field 'geometry.rate'"),
        ('"nvs/psnr"', '"nvs/snr"', r"suite.columns\[0\]: there is no measure 'snr'\nDid you mean 'psnr'"),
        ('"nvs/psnr"', '"nsv/psnr"', "there is no task 'nsv'\nDid you mean 'nvs'"),
        ('"nvs/psnr"', '"psnr"', "'psnr' is not a metric such as"),
        ('["nvs/psnr", "normal/mae"]', "[]", "suite.columns: .* is not a list of at least one metric"),
        ('["nvs/psnr", "normal/mae"]', '"nvs/psnr"', "suite.columns: 'nvs/psnr' is not a list"),
        ('reference = "a"', 'reference = "c"', "no row 'c'"),
        ('key = "b"', 'key = "a"', "rows of the same key: a"),
        ('"ablation"', '"ablations"', "there is no published table 'ablations'\nDid you mean 'ablation'"),
        ('name = "mine"', 'name = "ablations"', "is a suite that comes with the package"),
        *(
            ('name = "mine"', f'name = "{name}"', "suite.name: .*is not a name of at most 120 letters")
            for name in ("../mine", "..", ".", ".hidden", "a" * 200)
        ),
        ('name = "mine"', "name = ", "is no TOML"),
        ("scenes =", 'experiment = "trainig"\nscenes =', "there is no experiment 'trainig'\nDid you mean 'training'"),
    ],
)
def test_errors_of_a_suite_file_name_the_field_and_the_nearest_name(
    old: str, new: str, says: str, read: Callable[[str], Suite]
) -> None:
    assert old in WHOLE
    with pytest.raises(UsageError, match=f"(?s){says}"):
        read(WHOLE.replace(old, new))


STRANGERS = """
name = "mine"
title = "Two methods"
reference = "ours"
columns = ["nvs/psnr"]

[[rows]]
key = "ours"
text = "Ours"

[[rows]]
key = "chain"
text = "Chain, twice the weight"
method = "chain"
variant = { weight = 2 }
budget = { each = 2 }
"""


def test_rows_of_another_method_have_its_own_fields(
    read: Callable[[str], Suite], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(substitutes, "chain", Chain(("fit",)))
    suite = read(STRANGERS)
    assert [row.method for row in suite.rows] == ["radiogs", "chain"]
    _, cell = asked(1, suite).cells[1]
    assert (cell.variant, cell.budget.each) == (Turned(weight=2.0), 6)
    for old, new, says in (
        ("weight = 2", "wieght = 2", r"suite.rows\[1\].variant: there is no field 'wieght'\nDid you mean 'weight'"),
        ("weight = 2", "detach = 'pbr'", r"suite.rows\[1\].variant: there is no field 'detach'"),
        ("each = 2", "incident_samples = 2", r"suite.rows\[1\].budget: there is no field 'incident_samples'"),
        ('"chain"\nvar', '"chian"\nvar', r"suite.rows\[1\].method: unknown method 'chian'\nDid you mean 'chain'"),
    ):
        assert old in STRANGERS
        with pytest.raises(UsageError, match=says):
            read(STRANGERS.replace(old, new))


def test_a_wrong_file_ends_with_exit_code_2_and_a_missing_one_with_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "suite.toml"
    file.write_text(WHOLE.replace("title", "titel"))
    assert main(["run", str(file)]) == 2
    assert "Did you mean 'title'?" in capsys.readouterr().err
    assert main(["run", str(tmp_path / "nowhere.toml")]) == 3
    with pytest.raises(DataError, match="cannot read the suite"):
        read_suite(tmp_path)


def test_the_documented_example_is_the_file_and_runs(fake_run: Callable[..., int], tmp_path: Path) -> None:
    documented = (ROOT / "docs" / "suites.md").read_text()
    assert EXAMPLE.read_text() in documented
    assert fake_run(str(EXAMPLE)) == 0
    table = (tmp_path / f"{read_suite(EXAMPLE).name}.csv").read_text()
    for row in read_suite(EXAMPLE).rows:
        assert f"{row.key}," in table


def test_the_example_on_gains_of_plans_varies_effects_only() -> None:
    suite = read_suite(GAIN)
    everything, auto = suite.rows
    assert suite.experiment == EFFECTS_SUITE.experiment
    assert (everything.variant, auto.variant) == ({}, {"effects": "auto"})
    for row in suite.rows:
        assert scaled(PRESETS["small"], row.budget).inverse_iterations == 900
        assert scaled(PRESETS["small"], row.budget).geometry.steps == 1500


def test_every_field_is_documented() -> None:
    documented = (ROOT / "docs" / "suites.md").read_text()
    for kind, prefix in ((Suite, ""), (Row, "rows.")):
        for field in dataclasses.fields(kind):
            assert f"`{prefix}{field.name}`" in documented, field.name


def test_a_label_that_names_no_number_is_refused_before_anything_is_run(tmp_path: Path) -> None:
    text = EXAMPLE.read_text().replace("<consistency_surfels>", "<consistency_surfel>")
    (tmp_path / "wrong.toml").write_text(text)
    with pytest.raises(UsageError, match="names 'consistency_surfel'"):
        read_suite(tmp_path / "wrong.toml")


def test_a_deeply_nested_or_invalid_file_is_explained(tmp_path: Path) -> None:
    """Audit M23: nested TOML ended in a traceback. M33: a named pipe was waited for."""
    (tmp_path / "deep.toml").write_text("a = " + "[" * 100_000 + "]" * 100_000)
    with pytest.raises(UsageError, match="is no TOML"):
        read_suite(tmp_path / "deep.toml")
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(DataError, match="cannot read the suite"):
        read_suite(tmp_path / "pipe.toml")


def test_a_budget_beyond_all_bounds_is_refused_by_name() -> None:
    """Audit M30: a budget of 1e30 ended the run with an error of a conversion."""
    smallest = RADIOGS.presets["smoke"]
    for factor in (1e30, float("inf"), float("nan")):
        with pytest.raises(UsageError, match="smoke"):
            scaled(smallest, {"incident_samples": factor})
    assert scaled(smallest, {"incident_samples": 4.0}).incident_samples == 4 * smallest.incident_samples
