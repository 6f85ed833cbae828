"""Recipes of a method in suites and commands: rows run by them, and what is not there is refused by name."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.chain_method import Chain
from bench.fake_method import asked, scene_of
from radiogs.constants import recipe_table
from radiogs.method import RADIOGS
from radiogs.recipes import recipe_values
from radiogs.settings import PRESETS, Variant
from radiogs_bench.cli import main
from radiogs_bench.methods import nearest_recipe, variant_by_recipe
from radiogs_bench.runs.rows import of_methods, with_recipe
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.runs.trained_folder import read_about, read_trained
from radiogs_bench.store.folder import Store
from radiogs_bench.suites.paper import ABLATIONS, INDIRECT
from radiogs_bench.suites.registry import read_suite
from radiogs_bench.suites.suite import Row, Suite
from radiogs_core.errors import UsageError
from radiogs_core.plain_values import to_plain, with_values

ROOT = Path(__file__).parents[3]
FakeRun = Callable[..., int]


def by(recipe: str, layout: str = "", scene: str = "", **changed: Any) -> Variant:
    """RadioGS's variant by a recipe, with some fields changed."""
    return with_values(Variant(), {**recipe_values(recipe, layout, scene), **changed})


def test_rows_run_by_their_own_recipe_else_the_suites_else_the_methods() -> None:
    rows = (
        Row("ours", "Ours", "Ours", {"radiometric_weight": 0.1}),
        Row("code", "Code", "Code", {"materials.weights.mask": 0.5}, recipe="released"),
    )
    suite = replace(ABLATIONS, rows=rows)
    code = by("released", **{"materials.weights.mask": 0.5})
    for recipe, ours in (("printed", by("printed", radiometric_weight=0.1)), ("", Variant(radiometric_weight=0.1))):
        request = asked(1, replace(suite, recipe=recipe))
        assert [cell.variant for _, cell in request.cells] == [ours, code]
        lines = request.manifest()["rows"]
        shown = f"{recipe}, shortened (20 steps, rates x 12)" if recipe else "recommended"
        assert [line["recipe"] for line in lines] == [shown, "released, shortened (20 steps, rates x 12)"]


def test_a_recipe_may_differ_between_the_scenes_of_a_run() -> None:
    scenes = {scene.name: scene for scene in (scene_of("lego", "tensoir"), scene_of("ficus", "tensoir"))}
    suite = replace(ABLATIONS, rows=ABLATIONS.rows[:1], reference=ABLATIONS.rows[0].key, recipe="released")
    cells = asked(1, suite, scenes=scenes).cells
    assert {cell.scene: cell.variant for _, cell in cells} == {
        name: by("released", "tensoir", name) for name in ("lego", "ficus")
    }


def test_a_suite_file_names_recipes_and_unknown_ones_are_refused_at_their_place(tmp_path: Path, chain: Chain) -> None:
    content = """
name = "mine"
title = "Mine"
reference = "a"
recipe = "printed"
columns = ["nvs/psnr"]

[[rows]]
key = "a"
text = "A"

[[rows]]
key = "b"
text = "B"
recipe = "released"
variant = { radiometric_weight = 0.0 }

[[rows]]
key = "c"
text = "C"
method = "chain"
"""
    file = tmp_path / "suite.toml"

    def read(text: str) -> Suite:
        file.write_text(text)
        return read_suite(file)

    variants = [cell.variant for _, cell in asked(1, read(content)).cells]
    assert variants == [by("printed"), by("released", radiometric_weight=0.0), chain.variant()]
    for old, new, says in (
        ('recipe = "released"', 'recipe = "relaesed"', r"suite.rows\[1\].recipe: unknown recipe 'relaesed' of radiogs"),
        ('recipe = "printed"', 'recipe = "printd"', "suite.recipe: unknown recipe 'printd' of radiogs"),
        ('method = "chain"', 'method = "chain"\nrecipe = "printed"', r"rows\[2\].recipe: chain has no recipes"),
    ):
        assert old in content
        with pytest.raises(UsageError, match=says):
            read(content.replace(old, new))


def test_a_recipe_of_a_run_takes_the_place_of_the_suites_and_the_rows_that_keep_theirs_are_named(chain: Chain) -> None:
    suite, remarks = with_recipe(replace(INDIRECT, rows=INDIRECT.rows[3:]), "released")
    assert suite.recipe == "released"
    assert remarks == [f"row '{key}' keeps its recipe, recommended" for key in ("recommended-no-rad", "recommended")]
    both, remarks = with_recipe(of_methods(ABLATIONS, ["radiogs", "chain"]), "printed")
    assert remarks == ["rows of method 'chain' run as they are: it has no recipes"]
    variants = {place["row"]: cell.variant for place, cell in asked(1, both).cells}
    assert (variants["ours"], variants["chain"]) == (by("printed"), chain.variant())


def test_run_takes_a_recipe_or_refuses_it_by_name(
    fake_run: FakeRun, tmp_path: Path, chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fake_run("ablations", "--recipe", "printd") == 2
    said = capsys.readouterr().err
    assert "unknown recipe 'printd' of radiogs" in said
    assert "Did you mean 'printed'?" in said
    assert fake_run("ablations", "--method", "chain", "--recipe", "printed") == 2
    assert "chain has no recipes, and none called 'printed'" in capsys.readouterr().err
    assert fake_run("ablations", "--recipe", "printed", "--set", "materials.weights.mask=0.5") == 0
    assert {row["recipe"] for row in read_sweep(tmp_path)["rows"]} == {"printed, shortened (20 steps, rates x 12)"}
    variants = [result["cell"]["variant"] for result in Store(tmp_path).results()]
    assert to_plain(by("printed", **{"materials.weights.mask": 0.5})) in variants
    assert {variant["masking"] for variant in variants} == {"height-correlated"}


@pytest.mark.slow
def test_a_model_is_trained_by_a_recipe_and_opened_with_its_values(
    tmp_path: Path, chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["train", "convex", "--preset", "smoke", "--no-score", "--out", str(tmp_path), "--recipe"]
    assert main([*arguments, "printd"]) == 2
    assert "Did you mean 'printed'?" in capsys.readouterr().err
    assert main([*arguments, "printed", "--method", "chain"]) == 2
    assert "chain has no recipes" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert main([*arguments, "printed", "--set", "geometry.steps=12", "--set", "inverse_iterations=4"]) == 0
    run, trained = read_trained(tmp_path, torch.device("cpu"))
    assert run.variant == by("printed")
    facts = read_about(tmp_path)["facts"]
    assert facts["labels"]["recipe"] == "printed, as the paper prints it"
    assert facts["labels"]["length"].startswith("12 + 4 steps (paper: 40,000 + 20,000)")
    assert {*facts["remarks"]} == {f"{name}: {value}" for name, value in facts["labels"].items()}
    assert trained.facts()["labels"] == facts["labels"]


def test_the_recipes_of_a_method_are_printed_as_a_table(chain: Chain, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["methods", "radiogs", "--recipes"]) == 0
    assert capsys.readouterr().out == recipe_table()
    assert main(["methods", "chain", "--recipes"]) == 2
    assert "chain has no recipes" in capsys.readouterr().err
    assert main(["methods", "--recipes"]) == 2
    assert "recipes of which method?" in capsys.readouterr().err


def lines_in(text: str, cells: int) -> list[list[str]]:
    """The cells of the lines of Markdown tables that have so many, without heads and empty ones."""
    lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in text.splitlines() if line.startswith("|")]
    found = [[cell.strip() for cell in line] for line in lines if len(line) == cells]
    return [line for line in found if line[0].strip("-") and line[1]]


def test_the_page_of_recipes_has_every_value_that_differs_and_says_how_the_columns_of_recipes_follow() -> None:
    page = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    _, _, part = page.partition("\n## Values that differ\n")
    shown = lines_in(part.partition("\n## ")[0], 5)
    expected, exceptions = [], []
    for name, paper, code, printed, released, recommended, field, _ in lines_in(recipe_table(), 8):
        if field.startswith("`deviations."):
            assert f"| `{field.strip('`').removeprefix('deviations.')}` |" in page
            continue
        source = code if paper == "-" else paper
        if not source == code == recommended:
            expected.append([name, paper, code, recommended, field])
        exceptions += [name] * ((printed, released) != (source, code))
    assert shown == expected
    assert exceptions == ["power of the length rule", "power of the length rule for roughness", "points"]


def test_the_page_of_recipes_has_the_factors_of_the_length_rule() -> None:
    page = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    presets, rates = [PRESETS[name] for name in ("tiny", "small", "paper")], Variant().materials.rates
    for factors in (
        [preset.geometry.rate for preset in presets],
        [by("printed").materials.rates.factor(preset.inverse_iterations) for preset in presets],
        [rates.roughness_in(preset.inverse_iterations) / rates.roughness for preset in presets],
        [rates.factor(preset.inverse_iterations) for preset in presets],
    ):
        assert f"| {' | '.join(f'{factor:.2g}' for factor in factors)} |" in page


@pytest.mark.parametrize("recipe", RADIOGS.recipes)
def test_the_recipe_of_a_stored_variant_is_known_with_the_fields_that_were_changed(recipe: str, chain: Chain) -> None:
    given, stored = {"radiometric_weight": 0.0}, by(recipe, "tensoir", "lego", radiometric_weight=0.0)
    assert variant_by_recipe(RADIOGS, recipe, "tensoir", "lego", given) == stored
    assert nearest_recipe(RADIOGS, to_plain(stored), "tensoir", "lego", given) == (recipe, {})
    turned = with_values(stored, {"materials.weights.mask": 0.5})
    found = nearest_recipe(RADIOGS, to_plain(turned), "tensoir", "lego", given)
    assert found == (recipe, {"materials.weights.mask": 0.5})
    assert nearest_recipe(chain, {"weight": 2.0, "shown": 1.0}, "", "", {}) == ("", {"weight": 2.0})
