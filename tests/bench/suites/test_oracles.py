"""The oracle ladder in the harness: its rows, methods with and without given parts, and a run."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.chain_method import Chain, Turned
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs import train
from radiogs_bench.runs.engines.in_process import Task, run_cells
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.plan import RunPlan, planned
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.rows import of_methods
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.spec import RunSpec
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.store.folder import Store
from radiogs_bench.suites import scenes
from radiogs_bench.suites.own import ORACLES
from radiogs_bench.suites.registry import read_suite
from radiogs_bench.suites.suite import Row, Suite
from radiogs_core.capabilities import PARTS, Part
from radiogs_core.contract import StageSpec
from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.surfaces import SurfaceSamples
from radiogs_datasets import load_scene
from scenes import sphere_scene

CPU = torch.device("cpu")


def no_samples(spacing: float) -> SurfaceSamples:
    raise AssertionError("a stranger samples no surfaces")


SCENE = replace(sphere_scene(views=2, size=16), surfaces=no_samples)


@dataclass(frozen=True)
class Told(Turned):
    """Fields that ablations change, and the parts that are given."""

    told: tuple[str, ...] = ()


class Oracle(Chain):
    """A stranger that takes light and geometry as given, and nothing else."""

    given_parts = ("light", "geometry")
    variant = Told

    def stages(self, variant: Any, budget: Any) -> Sequence[StageSpec]:
        told = {"told": list(variant.told)}
        return [replace(spec, reads={**spec.reads, **told}) for spec in super().stages(variant, budget)]

    def with_given(self, variant: Told, parts: tuple[str, ...]) -> Told:
        return replace(variant, told=parts)


SMOKE = RunSpec("oracles", preset="smoke", protocol="default")


def asked(suite: Suite, method: Chain | None = None, **changes: Any) -> RunPlan:
    found: dict[str, Callable[[str], Any]] = {} if method is None else {"method": lambda name: method}
    scene = replace(SCENE, **changes)
    return planned(suite, {scene.name: scene}, SMOKE, **found)


def ladder(name: str, method: Chain, monkeypatch: pytest.MonkeyPatch) -> Suite:
    monkeypatch.setitem(substitutes, name, method)
    return of_methods(ORACLES, [name])


@pytest.fixture
def strangers(fake_run: Callable[..., int], monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """``run`` of strangers' methods on a scene whose truth is known."""
    monkeypatch.setattr(train, "train_and_score", train_and_score)
    monkeypatch.setattr(scenes, "load_scene", lambda name, **how: SCENE)
    return fake_run


def test_the_ladder_has_each_part_alone_and_left_out_alone() -> None:
    given = [frozenset(row.given or ()) for row in ORACLES.rows]
    assert len(set(given)) == len(given)
    assert {frozenset(), frozenset(PARTS), *(frozenset({part}) for part in PARTS)} <= {*given}
    assert {frozenset(PARTS) - {part} for part in PARTS} <= {*given}
    for own in ("albedo", "light"):  # giving it settles its own metric
        assert {frozenset(PARTS) - {own, other} for other in PARTS} <= {*given}
    cells = [cell for _, cell in asked(ORACLES).cells]
    assert [{*cell.variant.given} for cell in cells] == [{*each} for each in given]
    assert len({cell.first_key for cell in cells}) == 1  # stage 1 is trained once for all


def test_any_method_that_takes_parts_gets_the_rungs_that_it_can_take(monkeypatch: pytest.MonkeyPatch) -> None:
    method = Oracle(("fit",), name="oracle")
    request = asked(ladder("oracle", method, monkeypatch), method)
    told = {place["row"]: cell.variant.told for place, cell in request.cells}
    assert told == {
        "oracle-none": (), "oracle-geometry": ("geometry",), "oracle-light": ("light",),
        "oracle-geometry-light": ("geometry", "light"),
    }  # fmt: skip
    refused = {line["key"]: line["refused"] for line in request.lines if "refused" in line}
    assert refused["oracle-albedo"] == "oracle does not take albedo as given"
    assert refused["oracle-light-albedo"] == "oracle does not take albedo as given"
    assert refused["oracle-all"] == "oracle does not take albedo and roughness and indirect as given"
    assert told.keys() | refused.keys() == {f"oracle-{row.key}" for row in ORACLES.rows}
    assert request.suite.reference == "oracle-none"


def test_a_method_that_takes_no_given_part_is_refused_before_anything_runs(
    strangers: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    chain = Chain(("fit",))
    monkeypatch.setitem(substitutes, "chain", chain)
    assert main(["run", "oracles", "--method", "chain", "--preset", "smoke", "--out", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert "chain takes no part of the truth that suite 'oracles' gives" in message
    assert "docs/your_method.md" in message
    assert not chain.begun


def test_rows_that_a_method_cannot_run_give_their_reason(
    strangers: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    method = Oracle(("fit",), name="oracle")
    monkeypatch.setitem(substitutes, "oracle", method)
    assert main(["run", "oracles", "--method", "oracle", "--preset", "smoke", "--out", str(tmp_path)]) == 0
    assert "oracle does not take albedo as given" in " ".join(capsys.readouterr().out.split())
    assert len(method.begun) == 4
    summary = json.loads((tmp_path / "summary.json").read_bytes())
    cell = summary["cells"]["oracle-albedo"]["nvs/psnr"]
    assert (cell["mean"], cell["reason"]) == (None, "oracle does not take albedo as given")
    assert summary["cells"]["oracle-light"]["nvs/psnr"]["mean"] is not None
    rows = {row["key"]: row for row in summary["rows"]}
    assert rows["oracle-none"]["given"] == []
    assert rows["oracle-geometry-light"]["given"] == ["geometry", "light"]
    assert rows["oracle-light"]["method"] == "Chain"
    assert (tmp_path / "tables" / "ladder.csv").exists()
    assert {place["row"] for place in read_sweep(tmp_path)["cells"]} == {
        "oracle-none", "oracle-geometry", "oracle-light", "oracle-geometry-light"
    }  # fmt: skip


@pytest.mark.parametrize("missing", [{"surfaces": None}, {"training_light": None}])
def test_a_scene_whose_truth_is_not_known_ends_the_run_before_it_begins(missing: dict[str, None]) -> None:
    with pytest.raises(DataError, match=r"are not known: '(geometry|light)' cannot be given"):
        asked(ORACLES, **missing)


@pytest.mark.parametrize("given", ['["light"]', '["shape"]'])
def test_a_suite_of_a_file_may_give_parts(tmp_path: Path, given: str) -> None:
    path = tmp_path / "suite.toml"
    path.write_text(
        'name = "one"\ntitle = "One"\nreference = "none"\ncolumns = ["nvs/psnr"]\n'
        '[[rows]]\nkey = "none"\ntext = "Nothing"\ngiven = []\n'
        f'[[rows]]\nkey = "one"\ntext = "One part"\ngiven = {given}\n'
    )
    if "light" in given:
        assert [row.given for row in read_suite(path).rows] == [(), ("light",)]
    else:
        with pytest.raises(UsageError, match="'shape' is none of its values"):
            read_suite(path)


@pytest.mark.slow
def test_with_everything_given_albedo_is_at_its_ceiling_and_indirect_light_and_light_are_right(tmp_path: Path) -> None:
    """On ``convex``: what is left is the rasteriser's blur, and 20 steps of training do not move it."""
    parts: tuple[Part, ...] = ("geometry", "light", "albedo", "roughness")
    rows = (Row("none", "", "", given=()), Row("most", "", "", given=parts))
    scene = load_scene("convex")
    request = planned(replace(ORACLES, rows=rows), {"convex": scene}, SMOKE)
    bench = Bench(Store(tmp_path), CPU, LogProgress(), Interruption(), request.method, checksum_now)
    cells = [cell for _, cell in request.cells]
    tasks = [Task(cell, cell.key) for cell in cells]
    assert not run_cells(
        tasks, lambda each: train_and_score(bench, each, scene), bench.store, bench.progress, bench.interruption
    )
    found = {}
    for (place, cell), row in zip(request.cells, rows, strict=True):
        assert place["row"] == row.key
        result = bench.store.result(cell.key)
        found[row.key] = {name: each["value"] or 0.0 for name, each in result["metrics"].items()}
    assert result["facts"]["given"] == {"parts": list(parts)}
    none, most = found["none"], found["most"]
    assert most["albedo/psnr"] > max(30.0, none["albedo/psnr"] + 4)
    assert most["normal/mae"] < 5 < none["normal/mae"]
    assert most["environment/error_scaled"] < 1e-3 < none["environment/error_scaled"]
    assert most["roughness/mse"] < 1e-3 < none["roughness/mse"] / 3
