"""The documented recipe and the workflow are commands that the program has, and say the same."""

import shlex
from pathlib import Path

import yaml

from radiogs_bench.cli.main import build_parser

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "docs" / "examples" / "gate.yml"


def recipe() -> list[str]:
    block = (ROOT / "docs" / "gate.md").read_text().split("```sh\n", 1)[1].split("```", 1)[0]
    return [line.split(" && ")[0] for line in block.splitlines() if not line.startswith("#")]


def commands() -> list[str]:
    job = yaml.safe_load(WORKFLOW.read_text())["jobs"]["gate"]
    return [step["run"] for step in job["steps"] if "run" in step]


def test_the_recipe_has_five_lines_that_the_program_understands() -> None:
    assert len(recipe()) == 5
    for line in recipe()[1:]:
        program, *arguments = shlex.split(line)
        assert program == "radiogs-bench"
        assert callable(build_parser().parse_args(arguments).command)


def test_the_workflow_runs_the_recipe_without_the_update() -> None:
    install, *_, again, compared = recipe()
    assert commands() == [install, again, compared]
    assert "--update" not in compared


def test_the_workflow_ends_within_a_stated_time_and_may_only_read() -> None:
    content = yaml.safe_load(WORKFLOW.read_text())
    assert content["jobs"]["gate"]["timeout-minutes"] <= 15
    assert content["permissions"] == {"contents": "read"}
