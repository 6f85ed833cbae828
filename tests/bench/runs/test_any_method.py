"""A method of any number of stages runs, resumes, is listed, compared and shown like RadioGS."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.chain_method import Chain, Turned
from bench.fake_method import CPU
from radiogs_bench.cli import main
from radiogs_bench.errors import Interrupted, MethodFailed
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs import train
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.engines.in_process import Task, run_cells
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.sweep import read_sweep, state_of
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.schema import Result
from radiogs_bench.store.seal import sealed, strict_json
from radiogs_bench.suites import scenes
from radiogs_datasets.image_files import write_hdr
from scenes import sphere_scene

NAMES = [("fit",), ("coarse", "fine", "polish")]
PLAIN = sphere_scene(views=2, size=16)
SCENE = replace(
    PLAIN,
    test=tuple(replace(view, sources={**view.sources, "relit/white": view.sources["image"]}) for view in PLAIN.test),
)


def bench_of(chain: Chain, folder: Path, interruption: Interruption | None = None) -> Bench:
    return Bench(
        Store(folder), CPU, LogProgress(), interruption or Interruption(), lambda name: chain, checksum_now,
        checkpoint_seconds=0.0, checkpoint_share=math.inf,
    )  # fmt: skip


def cell(chain: Chain, seed: int = 0, **turned: float) -> Cell:
    return cell_of(chain, SCENE, Work(Turned(**turned), chain.presets["smoke"], seed))


def run(bench: Bench, *cells: Cell) -> None:
    tasks = [Task(each, each.key) for each in cells]
    failures = run_cells(
        tasks, lambda each: train_and_score(bench, each, SCENE), bench.store, bench.progress, bench.interruption
    )
    assert failures == []


def result(bench: Bench, of: Cell) -> Result:
    stored = bench.store.result(of.key)
    assert stored is not None
    return stored


@pytest.mark.parametrize("names", NAMES)
def test_a_result_names_every_stage_and_no_other(names: tuple[str, ...], tmp_path: Path) -> None:
    chain = Chain(names)
    bench, mine = bench_of(chain, tmp_path), cell(chain)
    run(bench, mine)
    stored = result(bench, mine)
    assert [stage["name"] for stage in stored["stages"]] == list(names)
    for name in ("losses", "trail"):
        assert list(stored[name]) == sorted(names)  # type: ignore[literal-required]
    for name in ("seconds", "work", "guards", "parts", "sessions"):
        assert stored[name].keys() == {*names, "evaluate"}  # type: ignore[literal-required]
    assert stored["work"] == {**{name: {"steps": 3} for name in names}, "evaluate": {}}
    assert stored["facts"].keys() == {"value"}
    assert stored["metrics"]["nvs/psnr"]["value"] is not None
    assert chain.begun == chain.closed == list(names)


@pytest.mark.parametrize("names", NAMES)
def test_stopping_after_any_step_gives_the_same_result(names: tuple[str, ...], tmp_path: Path) -> None:
    whole, stopped = bench_of(Chain(names), tmp_path / "whole"), tmp_path / "stopped"
    run(whole, cell(Chain(names)))
    chain, mine = Chain(names), cell(Chain(names))
    stops, expected = 0, 3 * len(names)  # in each stage after two of its three steps and after storing it
    while Store(stopped).result(mine.key) is None:
        interruption = Interruption()
        interruption.requested = stops < expected
        bench = bench_of(chain, stopped, interruption)
        try:
            train_and_score(bench, mine, SCENE)
        except Interrupted:
            stops += 1
    assert stops == expected
    assert chain.stepped == [name for name in names for _ in range(3)], "no step was taken twice"
    assert chain.closed == chain.begun
    for name in ("metrics", "work", "losses", "facts"):
        assert result(bench, mine)[name] == result(whole, mine)[name]  # type: ignore[literal-required]
    assert {len(sessions) for stage, sessions in result(bench, mine)["sessions"].items() if stage in names} == {3}
    assert not list(stopped.rglob("*.checkpoint.pt"))


def test_a_stage_that_fails_is_closed_and_those_before_it_are_kept(tmp_path: Path) -> None:
    chain = Chain(NAMES[1], broken="fine")
    bench, mine = bench_of(chain, tmp_path), cell(chain)
    with pytest.raises(MethodFailed, match=r"chain failed in step\(\) of stage 'fine', iteration 0: ArithmeticError"):
        train_and_score(bench, mine, SCENE)
    assert chain.closed == chain.begun == ["coarse", "fine"]
    chain.broken = ""
    run(bench, mine)
    assert chain.begun == ["coarse", "fine", "fine", "polish"]


def test_fields_that_only_rendering_reads_train_nothing_anew(tmp_path: Path) -> None:
    chain = Chain(NAMES[1])
    bench = bench_of(chain, tmp_path)
    run(bench, cell(chain), cell(chain, shown=0.5))
    assert chain.begun == list(NAMES[1])
    first, second = (result(bench, cell(chain, shown=shown))["metrics"]["nvs/psnr"]["value"] for shown in (1.0, 0.5))
    assert first != second


@pytest.mark.parametrize("names", NAMES)
def test_states_count_the_stages(names: tuple[str, ...], tmp_path: Path) -> None:
    chain = Chain(names)
    bench, mine = bench_of(chain, tmp_path), cell(chain)
    place = {"row": "r", "scene": "sphere", "seed": 0, "key": mine.key, "stages": [each.key for each in mine.stages]}
    seen = [state_of(bench.store, place)]  # type: ignore[arg-type]
    for stage in mine.stages:
        for name in (f"{product_name(stage.key)}.checkpoint", product_name(stage.key)):
            bench.store.put_tensors(name, {})
            seen.append(state_of(bench.store, place))  # type: ignore[arg-type]
    expected = ["to do"]
    for number in range(1, len(names) + 1):
        expected += [f"begun: in stage {number}", f"to do: stage {number} is there"]
    assert seen == [*expected[:-1], "trained, not scored"]


@pytest.fixture(params=NAMES, ids=["one stage", "three stages"])
def run_chain(
    request: pytest.FixtureRequest, fake_run: Callable[..., int], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., int]:
    """``radiogs-bench run SUITE --method chain``, two seeds."""
    monkeypatch.setitem(substitutes, "chain", Chain(request.param))
    monkeypatch.setattr(train, "train_and_score", train_and_score)
    monkeypatch.setattr(scenes, "load_scene", lambda name, **how: SCENE)
    return lambda *further: fake_run(*further, "--scenes", "sphere", "--method", "chain")


def test_a_run_of_another_method_has_a_table_a_status_and_a_gate(
    run_chain: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_chain("ablations", "--dry-run") == 0
    assert "2 of 2 cells to run" in capsys.readouterr().out
    assert run_chain("ablations") == 0
    said = capsys.readouterr()
    assert "Chain" in said.out
    sweep = read_sweep(tmp_path)
    assert [row["key"] for row in sweep["rows"]] == ["chain"]
    for stored in Store(tmp_path).results():
        assert stored["metrics"]["relight/psnr"]["reason"] == "Chain keeps light and surface in one"
    assert main(["status", str(tmp_path)]) == 0
    assert "2 of 2 cells finished" in capsys.readouterr().out
    baseline = tmp_path / "baseline.json"
    assert main(["gate", str(tmp_path), "--baseline", str(baseline), "--update"]) == 0
    assert main(["gate", str(tmp_path), "--baseline", str(baseline)]) == 0
    content = json.loads(baseline.read_text())
    kept = content["cells"]["sphere chain seed 0"]["work"]
    last = next(name for name in kept if name != "evaluate")
    kept[last]["steps"] += 1
    baseline.write_bytes(strict_json(sealed(content)))
    capsys.readouterr()
    assert main(["gate", str(tmp_path), "--baseline", str(baseline)]) == 1
    assert f"changed: sphere chain: stage {last}: less work, steps: " in capsys.readouterr().out
    assert main(["export", str(tmp_path)]) == 0
    assert main(["view", str(tmp_path)]) == 3
    assert "no surfels" in capsys.readouterr().err


@pytest.mark.parametrize("suite", ["effects", "cost", "finetune", "efficiency"])
def test_every_experiment_has_its_reports_for_another_method_alone(
    suite: str, run_chain: Callable[..., int], tmp_path: Path
) -> None:
    """Also the reports on plans and knobs, which the method does not have."""
    assert run_chain(suite) == 0
    assert [row["key"] for row in read_sweep(tmp_path)["rows"]] == ["chain"]
    assert (tmp_path / f"{suite}.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize("names", NAMES)
def test_a_model_of_another_method_is_trained_rendered_and_exported(
    names: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(substitutes, "chain", Chain(names))
    assert main(["train", "convex", "--method", "chain", "--preset", "smoke", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "value.txt").exists()
    assert not (tmp_path / "environment.exr").exists()
    assert main(["render", str(tmp_path), "--relight"]) == 0
    assert list((tmp_path / "render" / "image").glob("*.png"))
    said = capsys.readouterr().out
    assert "ms a frame" not in said  # its seconds mean nothing
    assert "no relit views: chain does not relight" in said
    write_hdr(tmp_path / "dim.hdr", np.full((8, 16, 3), 0.05, np.float32))
    assert main(["relight", str(tmp_path), "--envmap", str(tmp_path / "dim.hdr")]) == 1
    assert "error: Chain keeps light and surface in one" in capsys.readouterr().err


def test_options_that_another_method_has_no_field_for_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(substitutes, "chain", Chain(("fit",)))
    train = ["train", "convex", "--method", "chain", "--preset", "smoke", "--out", str(tmp_path)]
    assert main([*train, "--effects", "auto"]) == 2
    assert "chain has no choice of effects" in capsys.readouterr().err
    assert main([*train, "--recipe", "released"]) == 2
    assert "chain has no recipes, and none called 'released'" in capsys.readouterr().err
    assert main([*train, "--preset", "papr"]) == 2
    assert "unknown preset 'papr' of chain" in capsys.readouterr().err
    assert main([*train[:3], "chian", *train[4:]]) == 2
    assert "Did you mean 'chain'?" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
