"""The documented recipe and the workflow use existing commands, and agree."""

import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from radiogs_bench.cli.main import app, parsed, values_of
from radiogs_bench.results.baseline import read_baseline

ROOT = Path(__file__).parents[3]
WORKFLOWS = ("gate.yml", "own_method_gate.yml")
"""The workflow of a clone and that of another repository's method, as the document has their recipes."""

BOTH = pytest.mark.parametrize("place", [0, 1], ids=WORKFLOWS)


def recipe(place: int) -> list[str]:
    block = (ROOT / "docs" / "reliability.md").read_text().split("```sh\n")[1 + place].split("```", 1)[0]
    return [line.split(" && ")[0] for line in block.splitlines() if not line.startswith("#")]


def workflow(place: int) -> dict[str, Any]:
    return yaml.safe_load((ROOT / "docs" / "examples" / WORKFLOWS[place]).read_text())


@BOTH
def test_the_recipe_has_six_lines_that_the_program_understands(place: int) -> None:
    assert len(recipe(place)) == 6
    for line in recipe(place)[1:]:
        program, *arguments = shlex.split(line)
        assert program == "radiogs-bench"
        assert callable(parsed(app, arguments)[0])


@BOTH
def test_the_workflow_runs_the_recipe_without_the_update(place: int) -> None:
    install, *_, again, compared = recipe(place)
    commands = [step["run"] for step in workflow(place)["jobs"]["gate"]["steps"] if "run" in step]
    assert commands == [install, again, compared]
    assert "--update" not in compared


@BOTH
def test_the_workflow_ends_within_a_stated_time_and_may_only_read(place: int) -> None:
    content = workflow(place)
    assert content["jobs"]["gate"]["timeout-minutes"] <= 15
    assert content["permissions"] == {"contents": "read"}


def test_a_committed_baseline_is_whole_small_and_knows_a_rerun() -> None:
    files = sorted((ROOT / ".github").glob("gate-*.json"))
    assert [file.name for file in files] == ["gate-smoke.json"]
    for file in files:
        assert read_baseline(file)["reruns"] == 1
    assert sum(file.stat().st_size for file in files) < 200_000


def test_make_gate_runs_the_committed_baselines_runs() -> None:
    made = subprocess.run(["make", "-n", "gate"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    commands = [shlex.split(line) for line in made.splitlines() if "radiogs-bench " in line]
    compared = {each[2]: each[4] for each in commands if each[1] == "gate"}
    ran = {each[-1]: values_of(parsed(app, each[1:])[1]) for each in commands if each[1] == "run"}
    assert ran.keys() == compared.keys()
    for out, file in compared.items():
        baseline = read_baseline(ROOT / file)
        run = ran[out]
        assert (run["suite"], run["preset"]) == (baseline["suite"], baseline["preset"])
        cells = {f"{scene} {row} seed {seed}" for scene in run["scenes"] for row in run["rows"]
                 for seed in range(run["seeds"])}  # fmt: skip
        assert cells == baseline["cells"].keys()
