"""Rehearsals: measurements, forecasts from them, and early warnings of what does not fit."""

import ctypes
import json
import shutil
import signal
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from bench.fake_method import FAKE, FakeStage
from radiogs.rehearsing import INITIALISE_STEPS, TITLES, short_run
from radiogs.settings import PRESETS, Variant
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.lab.rehearsal.climb import refusal_of, sizes_of
from radiogs_bench.lab.rehearsal.growth import SizeResult, extended
from radiogs_bench.lab.rehearsal.limits import give_memory_back
from radiogs_bench.lab.rehearsal.phases import Phase, of_memory
from radiogs_bench.lab.rehearsal.plan import RehearsedRow
from radiogs_bench.lab.rehearsal.record import lines_of, whole_of
from radiogs_bench.store.provenance import resident
from radiogs_bench.store.seal import seal_of
from radiogs_core.instruments import recording
from radiogs_core.on_surfels import fit_geometry
from radiogs_core.surfels import density
from radiogs_datasets.registry import scene_folder

GIB = 2**30


def recorded(folder: Path) -> dict[str, Any]:
    record = json.loads((folder / "rehearsal.json").read_bytes())
    assert seal_of(record) == record["seal"]
    return record


@pytest.mark.slow
def test_radiogs_is_rehearsed_in_every_phase_at_every_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["corner", "--preset", "smoke", "--as", "3x40x32", "--test-views", "2", "--forecast-for", "rtx-4090"]
    look = fit_geometry.largest_contribution
    with patch.object(fit_geometry, "largest_contribution", side_effect=look) as looks:
        assert main(["rehearse", *given, "--out", str(tmp_path)]) == 0
    found = recorded(tmp_path)
    assert [rung["size"] for rung in found["rungs"]] == [100, 400, 600]
    assert looks.call_count == 3  # once at each size
    last = {phase["title"]: phase for phase in found["rungs"][-1]["phases"]}
    for stage in ("stage 1, initialisation", "stage 2, inverse rendering"):
        for work in ("beginning", "first step", "step", "writing a checkpoint", "resuming from it"):
            assert last[f"{stage}: {work}"]["seconds"], work
    assert last["stage 1, initialisation: round of density control"]["whole"] == 1
    assert last["stage 1, initialisation: step that looks for hidden surfels"]["whole"] == 7
    assert last["stage 2, inverse rendering: step that traces all light anew"]["whole"] == 1
    assert last["stage 2, inverse rendering: step"]["whole"] == 20 - 1 - 1
    for title in TITLES.values():
        assert last[f"relighting {title}: a frame"]["whole"] == 2 * 2 * 2  # two views, two lights, each twice
    assert last["relighting by surfels alone, fine-tuned: step of its preparation"]["whole"] == 2 * 10
    assert found["scene"] | {"remarks": 0} == {
        "name": "corner", "train": 3, "test": 2, "width": 40, "height": 32, "masks": True, "lights": 2, "remarks": 0,
    }  # fmt: skip
    assert [each["size"] for each in found["forecast"]] == [400, 600]
    assert all(each["measured"] and not each["beyond"] for each in found["forecast"])
    assert {path.name for path in tmp_path.iterdir()} <= {"rehearsal.json", "tracebacks", "aside"}
    assert "Forecast, not measured, for an NVIDIA GeForce RTX 4090" in capsys.readouterr().out


def test_a_size_that_does_not_fit_is_named_and_ends_with_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        assert main(["rehearse", "corner", "--preset", "smoke", "--memory", "0.01", "--out", str(tmp_path)]) == 1
    found = recorded(tmp_path)
    assert found["forecast"][0]["beyond"] == ["host"]
    assert "does not fit" in capsys.readouterr().out
    assert found["refusal"]["fits"] is False


def with_second_stage(kind: type[FakeStage]) -> Any:
    """The fake method, whose second stage is of this kind."""

    class Method(type(FAKE)):  # type: ignore[misc]
        def stages(self, variant: Any, budget: Any) -> Any:
            first, second = super().stages(variant, budget)
            return first, replace(second, begin=lambda run, before: kind(before["place"], 1.0, run.seed))

    return patch.dict(substitutes, {FAKE.name: Method()})


class Greedy(FakeStage):
    """Asks for more memory than any machine has."""

    def step(self) -> Mapping[str, float]:
        torch.empty(2**60, dtype=torch.uint8)
        return {}


def test_memory_that_ends_within_a_step_is_a_finding_and_no_failure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with with_second_stage(Greedy):
        assert main(["rehearse", "corner", "--preset", "smoke", "--out", str(tmp_path)]) == 1
    assert recorded(tmp_path)["refusal"]["why"] == "there was not enough memory for 'fake invert: step 0'"
    assert "Traceback" not in capsys.readouterr().err


class Endless(FakeStage):
    """Is stopped in its second step."""

    def step(self) -> Mapping[str, float]:
        if self.iteration:
            signal.raise_signal(signal.SIGTERM)
        return super().step()


def test_a_stopped_rehearsal_keeps_its_measurements(tmp_path: Path) -> None:
    with with_second_stage(Endless):
        assert main(["rehearse", "corner", "--preset", "smoke", "--out", str(tmp_path)]) == 130
    found = recorded(tmp_path)
    assert found["refusal"]["why"] == "it was stopped after 'fake invert: beginning'"
    assert found["forecast"] == []
    assert found["rungs"][0]["phases"][0]["title"] == "fake initialise: beginning"
    assert any("it was stopped" in line for line in lines_of(found))


def test_a_method_that_does_not_say_its_sizes_is_rehearsed_as_it_begins(tmp_path: Path) -> None:
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        assert main(["rehearse", "ablations", "--preset", "smoke", "--out", str(tmp_path), "--json"]) == 0
    found = recorded(tmp_path)
    assert found["size_name"] is None
    assert [rung["size"] for rung in found["rungs"]] == [None]
    assert set(found["rungs"][0]["rows"]) == {"ours", "no-rad", "detach-pbr", "detach-surfel", "nvs-init"}
    firsts = {keys[0] for keys in found["rungs"][0]["rows"].values()}
    begun = [phase["key"] for phase in found["rungs"][0]["phases"] if phase["title"] == "fake initialise: beginning"]
    assert sorted(begun) == sorted(firsts)  # once each, although four rows share one
    assert len(firsts) < 5


def test_the_rehearsed_suite_or_scene_is_opened_with_the_options(tmp_path: Path) -> None:
    (tmp_path / "data" / "made").mkdir(parents=True)
    shutil.copytree(scene_folder("corner"), tmp_path / "data" / "made" / "room")
    where = ["made/room", "--data", str(tmp_path / "data"), "--long-side", "20"]
    with patch.dict(substitutes, {FAKE.name: FAKE}):
        assert main(["rehearse", *where, "--preset", "smoke", "--out", str(tmp_path / "out")]) == 0
    found = recorded(tmp_path / "out")["scene"]
    assert (found["name"], found["width"], found["height"]) == ("room", 20, 20)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["corner", "--as", "3x40"], 2),
        (["corner", "--no-masks"], 2),
        (["corner", "--core-seconds", "--threads", "2"], 2),
        (["corner", "--sizes", "10,0"], 2),
        (["corner", "--forecast-for", "abacus"], 2),
        (["stability"], 2),
        (["no_such_scene"], 3),
        (["corner", "--preset", "papre"], 2),
    ],
)
def test_impossible_options_are_refused(arguments: list[str], code: int, tmp_path: Path) -> None:
    assert main(["rehearse", *arguments, "--out", str(tmp_path / "out")]) == code


def test_a_short_run_of_the_papers_budget_keeps_its_sizes_and_counts_its_steps() -> None:
    short = short_run(Variant(), PRESETS["paper"], 2_000_000)
    assert short.variant.geometry.start.points == "hull"
    assert short.budget.geometry.initial_surfels == short.budget.geometry.maximum_surfels == 2_000_000
    assert (short.budget.consistency_surfels, short.budget.incident_samples) == (4096, 64)
    kinds = {name: {kind.title: kind for kind in kinds} for name, kinds in short.kinds.items()}
    assert sum(kind.whole for kind in kinds["initialise"].values()) == 40_000
    assert kinds["initialise"]["round of density control"].whole == 49
    assert kinds["initialise"]["step that looks for hidden surfels"].whole == 7
    assert sum(kind.whole for kind in kinds["invert"].values()) == 20_000
    assert kinds["invert"]["step that traces all light anew"].whole == 199
    assert {way.variant.relighting: way.whole for way in short.relighting} == {
        "pbr": 0, "bounces": 0, "finetuned": 2000, "surfels": 2000,
    }  # fmt: skip


def test_density_rounds_and_hidden_searches_occur_as_the_short_run_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    from radiogs.method import RADIOGS
    from radiogs_core.contract import Run
    from radiogs_datasets import load_scene

    short = short_run(Variant(), PRESETS["smoke"], 80)
    happened: list[str] = []
    changed, contribution = density.AdaptiveDensityControl.changed_surfels, fit_geometry.largest_contribution
    monkeypatch.setattr(
        density.AdaptiveDensityControl,
        "changed_surfels",
        lambda self, *rest: happened.append("round") or changed(self, *rest),
    )
    monkeypatch.setattr(
        fit_geometry, "largest_contribution", lambda *given: happened.append("looks") or 0 * contribution(*given)
    )
    scene = load_scene("corner")
    run = Run(replace(scene, train=scene.train[:3]), short.variant, short.budget, 0, torch.device("cpu"))
    stage = RADIOGS.stages(run.variant, run.budget)[0].begin(run, {})
    at: dict[str, set[int]] = {"round": set(), "looks": set()}
    for step in range(INITIALISE_STEPS):
        happened.clear()
        before = len(stage.surfels)
        with recording():
            stage.step()
        for each in happened:
            at[each].add(step)
        if "round" not in happened:
            assert len(stage.surfels) == before
    for what, steps in at.items():
        assert steps
        assert steps == next(kind for kind in short.kinds["initialise"] if what in kind.title).steps


def test_a_variant_that_never_looks_for_hidden_surfels_has_no_such_step() -> None:
    learning = Variant().geometry
    without = Variant(geometry=replace(learning, density=replace(learning.density, hidden_at=())))
    short = short_run(without, PRESETS["paper"], 100)
    assert short.variant.geometry.density.hidden_at == ()
    assert {kind.title: kind.whole for kind in short.kinds["initialise"]} == {
        "step": 40_000 - 49, "round of density control": 49,
    }  # fmt: skip


def rung(size: int, seconds: float, peak: float, base: float = 1.0) -> SizeResult:
    phase = Phase("step", f"key-{size}", (seconds, seconds), 10, {"host": round(peak * GIB)})
    return SizeResult(size, {"host": round(base * GIB)}, [phase], {"ours": [phase.key]}, {}, 2 * seconds, 1.0)


def test_another_size_lies_on_the_line_through_the_last_two() -> None:
    both = extended([rung(100, 2.0, 3.0), rung(200, 2.5, 3.5)], 400)[0]
    assert both.mean == pytest.approx(3.5)
    assert both.peaks["host"] / GIB == pytest.approx(4.5)
    assert extended([rung(100, 2.0, 3.0), rung(200, 1.0, 2.0)], 400)[0].mean == pytest.approx(1.0)


def test_the_uncertainty_of_an_extrapolation_grows_with_its_distance() -> None:
    generator = np.random.default_rng(3)
    ends = [[rung(size, 0.0, 1.0) for size in (100, 200)] for _ in range(2000)]
    errors = []
    for pair in ends:
        steps = [tuple(mean + generator.normal(size=4)) for mean in (10.0, 20.0)]
        noisy = [
            replace(each, phases=[replace(each.phases[0], seconds=step)])
            for each, step in zip(pair, steps, strict=True)
        ]
        far = extended(noisy, 400)[0]
        errors.append((far.mean - 40.0, far.error))
    spread, told = np.std([off for off, _ in errors]), np.sqrt(np.mean([error**2 for _, error in errors]))
    assert told == pytest.approx(spread, rel=0.06)


def test_sizes_that_would_not_fit_or_take_too_long_are_not_tried() -> None:
    rungs = [rung(100, 2.0, 3.0), rung(200, 2.5, 3.5)]
    assert refusal_of(rungs, 400, {"host": 5 * GIB}, 1e6) is None
    # From one size alone nothing is concluded about memory: most of it may be that of the images.
    assert refusal_of(rungs[:1], 400, {"host": 4 * GIB}, 1e6) is None
    tight = refusal_of(rungs, 400, {"host": 4 * GIB}, 1e6)
    assert tight is not None
    assert not tight.fits
    assert "would take 4.5 GiB of the host's 4.0" in tight.why
    late = refusal_of(rungs, 400, {"host": 5 * GIB}, 9.0)
    assert late is not None
    assert late.fits


def test_rows_that_share_a_stage_train_it_once_and_are_shown_each() -> None:
    phases = [
        Phase("step", "shared", (1.0, 3.0), 10, {}),
        Phase("step", "own", (1.0,), 5, {}),
        Phase("frame", "own shown", (0.5,), 4, {}),
    ]
    rows = {"a": ["shared", "own", "own shown"], "b": ["shared", "own", "own shown"]}
    seconds, error = whole_of(phases, rows, cells=3)
    assert seconds == pytest.approx(3 * (20 + 5 + 2 * 2))
    assert error == pytest.approx(3 * 10 * phases[0].error)
    assert phases[0].error == pytest.approx(1.0)


def test_sizes_grow_fourfold_from_a_quarter_of_the_start_to_the_largest() -> None:
    from radiogs.method import RADIOGS

    assert sizes_of([RehearsedRow("a", RADIOGS, "radiogs", Variant(), PRESETS["paper"])]) == [
        25_000, 100_000, 400_000, 1_600_000, 2_000_000,
    ]  # fmt: skip


def test_only_errors_of_allocation_count_as_a_lack_of_memory() -> None:
    assert of_memory(MemoryError())
    assert of_memory(RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried"))
    assert not of_memory(RuntimeError("shapes do not match"))
    assert not of_memory(None)


def test_the_documents_lines_are_those_of_the_stored_rehearsals() -> None:
    documents = Path(__file__).parents[3] / "docs"
    text = (documents / "gpu.md").read_text(encoding="utf-8")
    files = sorted((documents / "paper_scale").glob("*.json"))
    assert files
    for file in files:
        record = json.loads(file.read_bytes())
        block = text.partition(f"<!-- rehearsal {file.stem} -->")[2].partition("<!-- end of rehearsal -->")[0]
        whole = lines_of(record)
        shown = [line for line in block.splitlines() if line.startswith(("| ", "- ", "`"))]
        assert set(shown) <= set(whole)
        assert set(shown) >= {line for line in whole if line.startswith("- Forecast")} | {whole[0]}
        assert any("stage 2, inverse rendering: step |" in line for line in shown)
        for range_said, forecast in zip(("54 s to 16 min", "13 min to 3.9 h"), record["forecast"], strict=True):
            assert range_said in " ".join(block.split())
            low, high = (forecast["seconds"] * ratio for ratio in record["other"]["ratios"])
            assert range_said == f"{brief(low)} to {brief(high)}"


def brief(seconds: float) -> str:
    """Seconds, minutes or hours, to two digits."""
    value, unit = next((seconds / each, unit) for each, unit in ((3600, "h"), (60, "min"), (1, "s")) if seconds >= each)
    return f"{value:.2g} {unit}"


def test_the_memory_of_one_size_does_not_count_for_the_next() -> None:
    """Freed blocks below one that is in use stay with the process until they are given back."""
    if getattr(ctypes.CDLL(None), "malloc_trim", None) is None:
        pytest.skip("this C library cannot give freed memory back")
    blocks = [bytearray(b"x" * 60_000) for _ in range(4000)]
    last = bytearray(b"x" * 60_000)
    full = resident()
    del blocks
    give_memory_back()
    assert full - resident() > 150e6
    assert len(last) == 60_000
