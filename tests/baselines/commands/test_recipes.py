"""Recipes of the published codes: their files are sound, and each command finds what the one before it has written."""

import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from baselines.commands.bench import Bench
from baselines.commands.stand_in import entries, is_relit
from public_outputs import WRITERS, noisy
from radiogs_baselines.commands.method import CommandMethod, read_method
from radiogs_baselines.commands.workspace import Workspace
from radiogs_baselines.outputs.codes import CODES
from radiogs_bench.installed_methods import recipes
from radiogs_core.scene.scene import Scene

STAND_IN = Path(__file__).with_name("stand_in_python.py")
RECIPES = recipes()


def test_there_is_a_recipe_for_each_published_code() -> None:
    methods = {name: read_method(path) for name, path in RECIPES.items()}
    assert {method.name for method in methods.values()} == set(RECIPES)
    assert {method.file.reader for method in methods.values()} == set(CODES) - {"plain"}
    for method in methods.values():
        assert set(method.presets) == {"smoke", "tiny", "small", "paper"}
        assert len(method.file.code.commit) >= 7
        assert len(method.file.traps) >= 5
        assert all(trap.endswith(".") for trap in method.file.traps)


def test_recipes_are_part_of_the_package() -> None:
    folders = {path.parent for path in RECIPES.values()}
    assert [folder.parent.name for folder in folders] == ["commands"]


@pytest.fixture(scope="module")
def scene(convex: Scene) -> Scene:
    """Views with names of their own, which every layout can tell."""
    test = tuple(replace(view, name=f"views/{index:03}") for index, view in enumerate(convex.test[:2]))
    return replace(convex, test=test, name="lego")


def steps(method: CommandMethod, workspace: Workspace, pantry: Path) -> list[Mapping[str, object]]:
    """The files that each command of the recipe writes, in order."""
    shelf, results, file = entries(pantry), workspace.results, method.file
    shown = [(str(pantry / path), str(results / path)) for path in shelf if not is_relit(path)]
    plan: list[dict[str, object]] = [
        {"write": [text.format_map(workspace.named()) for text in each.writes], "copy": []} for each in file.train
    ]
    plan += [{"write": [], "copy": shown}] if file.render else []
    if not file.render:
        plan[-1]["copy"] = shown
        plan[-1]["write"] = [text for text in plan[-1]["write"] if "imgs" not in text]  # type: ignore[attr-defined]
    every = [(str(pantry / path), str(results / path)) for path in shelf if is_relit(path)]
    if file.relight is None:
        return plan
    if file.relight.all_lights:
        return [*plan, {"write": [], "copy": every}]
    by_light = [[pair for pair in every if light in pair[0]] for light in workspace.run.scene.lights]
    return plan + [{"write": [], "copy": pairs} for pairs in by_light]


@pytest.mark.slow
@pytest.mark.parametrize("name", RECIPES)
def test_a_recipe_runs_to_its_end(name: str, scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    method = read_method(RECIPES[name])
    here = replace(scene, layout=method.file.layouts[0])
    code = method.file.code
    interpreter = tmp_path / "python"
    interpreter.write_text(f"#!{sys.executable} -S\n" + STAND_IN.read_text())
    interpreter.chmod(0o755)
    monkeypatch.setenv(code.variable, str(tmp_path))
    monkeypatch.setenv(code.python, str(interpreter))
    plan = tmp_path / "plan.json"
    monkeypatch.setenv("STAND_IN_PLAN", str(plan))
    WRITERS[method.file.reader](tmp_path / "pantry", noisy(here))
    bench = Bench(method, here, tmp_path / "work")
    plan.write_text(json.dumps(steps(method, Workspace.of(method.file, method.home, bench.run), tmp_path / "pantry")))
    trained = bench.train()
    prepared = trained.prepare()
    assert {"image", "albedo", "roughness", "normal"} <= prepared.render(here.test[0].camera).keys()
    for light in here.lights.values() if method.file.relight else ():
        assert "image" in trained.prepare(light).render(here.test[0].camera)
    assert json.loads(plan.read_text()) == []
    assert set(method.file.traps) <= set(trained.facts()["remarks"])
