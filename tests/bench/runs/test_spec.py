"""A run as a value: the same from the shell, from Python and from JSON; a stranger's value runs nothing of theirs."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import radiogs_bench as rb
from bench.fake_method import asked
from radiogs_bench.runs.plan import resolve
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.runs.sweep import read_sweep, shown_preset
from radiogs_bench.store.seal import sealed
from radiogs_core.errors import UsageError
from radiogs_datasets.options import SceneOptions

SPEC = RunSpec(
    "ablations",
    rows=("ours", "no-rad"),
    scenes=("corner",),
    scene_options=SceneOptions(long_side=48),
    seeds=2,
    preset="smoke",
    settings={"inverse_iterations": 7, "materials.rates.light": 0.5},
    recipe="printed",
    effects=("indirect", "visibility"),
    shard=(1, 2),
    keep_views=3,
)


def test_a_spec_is_the_same_through_json_and_by_keywords() -> None:
    effects = RunSpec.from_json(SPEC.to_json())
    assert effects == SPEC
    assert effects.effects == ("visibility", "indirect"), "names are kept in the order of effects"
    given: dict[str, Any] = {
        "rows": ["ours", "no-rad"], "scenes": ["corner"], "long_side": 48, "seeds": 2, "preset": "smoke",
        "set": {"inverse_iterations": 7, "materials.rates.light": 0.5}, "recipe": "printed", "protocol": None,
        "effects": ["visibility", "indirect"], "shard": [1, 2], "keep_views": 3,
    }  # fmt: skip
    assert RunSpec.of("ablations", **given) == SPEC


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"seeds": 0}, "0 seeds: one run takes 1 to 10000"),
        ({"seeds": 10_001}, "10001 seeds"),
        ({"shard": [2, 2]}, "there is no part 2 of 2"),
        ({"threads": 0}, "threads: 0 is too small"),
        ({"effects": "sunshine"}, "sunshine"),
        ({"effects": "auto", "settings": {"effects": "all"}}, "'effects' is set twice"),
        ({"reduce": 0}, "leaves no pixels"),
        ({"rows": "ours"}, "rows: 'ours' is not a list"),
        ({"sedes": 2}, "Did you mean 'seeds'?"),
    ],
)
def test_impossible_runs_are_refused(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError) as refused:
        RunSpec.of("ablations", **changes)
    assert says in str(refused.value)


@pytest.mark.parametrize("text", ["{", "[]", '{"suite": 3}', '{"suite": "ablations", "out": "/"}'])
def test_json_that_is_no_spec_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        RunSpec.from_json(text)


def test_a_spec_that_the_shell_wrote_asks_for_the_same_cells_in_python(
    fake_run: Callable[..., int], tmp_path: Path
) -> None:
    assert fake_run("ablations", "--rows", "ours,no-rad", "--set", "view_share=0.5", "--recipe", "printed") == 0
    stored = read_sweep(tmp_path)
    spec = RunSpec.from_json(json.dumps(stored["spec"]))
    assert [ref for ref, _ in resolve(spec).cells] == stored["cells"]
    finished = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()}
    table = rb.run(spec, tmp_path)
    assert {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()} == finished
    assert len(table) == 2
    other = resolve(replace(spec, settings={}))
    assert not {ref["key"] for ref, _ in other.cells} & {ref["key"] for ref in stored["cells"]}


def test_a_folder_of_an_earlier_version_has_its_settings_in_the_name_of_its_preset(tmp_path: Path) -> None:
    made = asked(1, settings={"inverse_iterations": 7}).manifest()
    assert (made["preset"], shown_preset(made)) == ("smoke", "smoke with inverse_iterations = 7")
    old: dict[str, Any] = {**made, "preset": "smoke with inverse_iterations = 7"}
    del old["spec"], old["marks"]
    (tmp_path / "sweep.json").write_text(json.dumps(sealed(old)))
    read = read_sweep(tmp_path)
    assert (read["preset"], read["marks"]) == ("smoke", "inverse_iterations = 7")


def test_a_spec_from_a_strangers_folder_runs_nothing_of_theirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    ran = tmp_path / "PWNED"
    Path("evil.toml").write_text(f'name = "innocent"\n[train]\ncommand = ["touch", "{ran}"]\n')
    hostile = {**SPEC.plain(), "methods": ["evil.toml"], "rows": []}
    with pytest.raises(UsageError, match="which this command does not name"):
        rb.run(RunSpec.from_plain(hostile), tmp_path / "out")
    assert not ran.exists()
    assert not (tmp_path / "out").exists()


FROM_PYTHON = """
import sys, traceback
from pathlib import Path
import radiogs_bench as rb
from radiogs_core.on_surfels.fit_geometry import FitGeometry

step, ways = FitGeometry.step, []

def watched(stage, *given):
    ways.append([Path(frame.filename) for frame in traceback.extract_stack()[1:]])
    return step(stage, *given)

FitGeometry.step = watched
rb.run("ablations", "out", preset="smoke", scenes=["corner"], rows=["ours"], long_side=32)
print([name for name in sys.modules if name.startswith("radiogs_bench.cli") or name == "cyclopts"])
print(*dict.fromkeys(path.stem for path in ways[-1] if "radiogs_bench" in path.parts))
"""
"""A run in a process of its own; it prints the parsers that it loaded, and the files between ``rb.run`` and a step."""


@pytest.mark.slow
def test_a_run_from_python_loads_no_parser_and_reaches_a_step_through_few_files(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", FROM_PYTHON], capture_output=True, text=True, check=True, cwd=tmp_path)
    parsers, way = done.stdout.splitlines()
    assert parsers == "[]"
    assert way.split()[0] == "whole_runs"
    assert len({*way.split(), "plan", "the stage"}) <= 7
