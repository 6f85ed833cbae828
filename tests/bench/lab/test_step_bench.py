"""``bench steps``: what it times, counts and says where time goes; ratios, history and the document."""

import importlib.util
import json
import mmap
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest
import torch

from bench.fake_method import FAKE
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.lab.kernels.clock import processor_seconds
from radiogs_bench.lab.kernels.scenes import sphere_and_plane
from radiogs_bench.lab.steps import yardsticks
from radiogs_bench.lab.steps.document import table_of, with_tables
from radiogs_bench.lab.steps.history import append, read_history
from radiogs_bench.lab.steps.measure import PARTS, Looking, Times, counting, placed
from radiogs_bench.lab.steps.passes import one_pass
from radiogs_bench.lab.steps.ratios import as_table, compared, read_record, require_comparable
from radiogs_bench.lab.steps.record import frames_said, parts_said
from radiogs_bench.lab.steps.sizes import SIZES
from radiogs_bench.lab.steps.subject import (
    ON_SURFACES,
    OWN_START,
    subject_of,
)
from radiogs_bench.methods import method
from radiogs_core.errors import DataError, UsageError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.surfel.footprint import frames
from radiogs_datasets import load_scene

ROOT = Path(__file__).parents[3]
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A record of the smallest size, and the history that it began."""
    folder = tmp_path_factory.mktemp("steps")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yardsticks, "REPETITIONS", 1)
        patch.setitem(yardsticks.SCENES, "M", sphere_and_plane)  # a hundredth of the rays
        return _measured(folder)


def _measured(folder: Path) -> tuple[Path, Path]:
    record, history = folder / "steps.json", folder / "history.jsonl"
    given = ["--sizes", "smoke", "--passes", "2", "--json", str(record), "--history", str(history)]
    assert main(["bench", "steps", *given]) == 0
    return record, history


def test_all_kinds_of_steps_beginnings_of_stages_and_frames_are_measured(measured: tuple[Path, Path]) -> None:
    record = read_record(measured[0])
    size = record["sizes"]["smoke"]
    assert (size["surfels"], size["side"], size["model"]) == (400, 32, ON_SURFACES)
    rows = {row["title"]: row for row in size["rows"]}
    one, two = "stage 1, initialisation", "stage 2, inverse rendering"
    once = {f"{one}: beginning", f"{two}: beginning", f"{two}: step that traces all light anew"}
    assert {*once, f"{one}: step", f"{two}: step", f"{one}: round of density control"} <= rows.keys()
    assert sum("a frame" in title for title in rows) == 4
    assert all([len(each) for each in rows[title]["passes"]] == [1] for title in once), (
        "the pass that counts is left out"
    )
    assert [len(each) for each in rows[f"{two}: step"]["passes"]] == [7, 8]
    for title, row in rows.items():
        assert row["median"] > 0 or "a frame" in title, "a frame may take less than a tick of the processor's clock"
        assert row["operations"] > 30
        assert sum(row["parts"].values()) == pytest.approx(1) or not row["parts"]
        assert row["page faults"] is None or row["page faults"] >= 0
    assert rows[f"{one}: step"]["launches"] > 10
    assert isinstance(rows[f"{one}: step"]["page faults"], int)
    assert "rays" not in rows[f"{one}: step"]["work"]
    anew, usual = (rows[f"{two}: {kind}"]["work"]["rays"] for kind in ("step that traces all light anew", "step"))
    count, rest = divmod(anew - usual, 2 * 8)  # two sets of directions
    assert rest == 0
    assert 300 <= count <= 400, "density control prunes a few"
    assert set(record["yardsticks"]) >= {"PyTorch, 1024 x 1024 matrices"}


def test_a_frame_by_rays_shades_and_one_by_surfels_alone_does_not(measured: tuple[Path, Path]) -> None:
    rows = {row["title"]: row["work"] for row in read_record(measured[0])["sizes"]["smoke"]["rows"]}
    count, rest = divmod(rows["relighting by rays, split sum: a frame"]["shaded_samples"], 32)
    assert rest == 0
    assert 300 <= count <= 400
    assert "shaded_samples" not in rows["relighting by surfels alone, fine-tuned: a frame"]


def test_a_method_that_cannot_be_rehearsed_is_measured_as_it_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(substitutes, FAKE.name, FAKE)
    done: list[str] = []

    def observe(titles: tuple[str, ...], work: Any) -> Any:
        done.extend(titles)
        return work()

    subject = subject_of(method(FAKE.name), load_scene("corner"), SIZES["smoke"], CPU)
    assert one_pass(subject, observe) == OWN_START
    assert any(title.endswith(": step") for title in done)


def test_the_help_names_every_size(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", "steps", "--help"])
    said = capsys.readouterr().out
    assert all(size in said for size in SIZES)


def test_every_part_names_modules_that_exist() -> None:
    for places in PARTS.values():
        for place in places:
            assert importlib.util.find_spec(place) is not None, place


def _inside(module: str, function: Callable[[float], None]) -> Callable[[float], None]:
    """The function as if it were of another module."""
    return FunctionType(function.__code__, {"time": time, "__name__": module}, function.__name__)


def _busy(seconds: float) -> None:
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass


def test_processor_time_has_no_ticks_while_the_stack_is_looked_at() -> None:
    """A scheduler's tick is 4 ms or more: a step of 20 ms would be a handful of them. (To ask for a thread's time in
    between would bring that of the process up to date.)"""
    seen, until = set(), time.perf_counter() + 0.2
    with Looking():
        while time.perf_counter() < until:
            seen.add(processor_seconds())
    assert len(seen) > 1000


@pytest.mark.slow
def test_the_worker_imports_nothing_of_the_kit_that_it_does_not_measure() -> None:
    """Another checkout's kit may lack what evaluation and kernel benches of this one import."""
    code = "import sys, radiogs_bench.lab.steps.worker; print(*(name for name in sys.modules if 'bench' in name))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "radiogs_bench.lab.steps.measure" in found
    allowed = ("radiogs_bench.scoring.metrics", "radiogs_bench.lab.kernels.clock")
    unwanted = ("radiogs_bench.scoring.", "radiogs_bench.lab.kernels.c")
    assert not [name for name in found if name.startswith(unwanted) and not name.startswith(allowed)]


def test_time_is_charged_to_the_part_and_the_direction_that_took_it() -> None:
    class Traced(torch.autograd.Function):
        @staticmethod
        def forward(context: Any, value: torch.Tensor) -> torch.Tensor:
            _inside("radiogs_core.learning.losses", _busy)(0.03)
            return value.clone()

        @staticmethod
        def backward(context: Any, slope: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
            _inside("radiogs_core.kernels.trace.hits", _busy)(0.09)
            return slope

    with Looking() as looking:
        Traced.apply(torch.ones(1, requires_grad=True)).sum().backward()  # type: ignore[no-untyped-call]
    shares = looking.shares()
    assert shares["tracing, backward"] == pytest.approx(0.75, abs=0.15)
    assert shares["image losses, forward"] == pytest.approx(0.25, abs=0.15)
    assert placed(None) == ("other", "forward")


def test_page_faults_are_those_of_memory_that_is_new() -> None:
    times, pages = Times(CPU, counts=False), 4096
    kept = mmap.mmap(-1, pages * mmap.PAGESIZE)

    def touch() -> None:
        for page in range(pages):
            kept[page * mmap.PAGESIZE] = 1

    times(("first",), touch)
    times(("again",), touch)
    assert times.faults["first"][0] >= pages
    assert times.faults["again"][0] < pages / 10


def test_frames_by_rays_are_told_beside_those_by_surfels_alone() -> None:
    def frames(way: str, seconds: float) -> dict[str, Any]:
        return {"title": f"relighting {way}: a frame", "passes": [[seconds], [1.1 * seconds], [0.9 * seconds]]}

    alone, rays = frames("by surfels alone, fine-tuned", 0.01), frames("by rays, split sum", 0.055)
    preparing = {**rays, "title": "relighting by rays, split sum: preparing"}
    assert list(frames_said({"rows": [preparing, rays, alone]})) == [
        "A frame of relighting by rays, split sum takes 5.5 (5.5 to 5.5) times as long as one of relighting by surfels"
        " alone, fine-tuned."
    ]
    assert list(frames_said({"rows": [rays]})) == []
    assert list(frames_said({"rows": [rays, {**alone, "passes": [[0.0]]}]})) == []


def test_operations_are_counted_with_those_of_the_backward_pass() -> None:
    value = torch.ones(3, requires_grad=True)
    with counting() as forward:
        total = (value * 2).sum()
    with counting() as both:
        (value * 2).sum().backward()
    assert forward.operations == 2
    assert both.operations > 4
    assert both.launches == 0
    assert total.item() == 6


def test_each_launch_of_a_kernel_is_counted() -> None:
    use_threads(1)
    with counting() as counts:
        for _ in range(3):
            frames(torch.ones(2, 4))
    assert counts.launches == 3


def test_records_are_compared_on_one_machine_and_tell_of_other_work(measured: tuple[Path, Path]) -> None:
    record = read_record(measured[0])
    size = record["sizes"]["smoke"]
    other = json.loads(json.dumps(size))
    other["rows"][0]["passes"] = [[2 * value for value in each] for each in other["rows"][0]["passes"]]
    other["rows"][-1]["work"] = {name: 2 * amount for name, amount in other["rows"][-1]["work"].items()}
    first, *_, last = compared(size, other, paired=False)
    assert first["value"] == pytest.approx(2)
    assert first["other work"] == {}
    assert set(last["other work"].values()) == {0.5}
    other["rows"][0]["passes"] = [[0.0]]
    first, *_ = compared(size, other, paired=False)
    assert (first["value"], first["low"]) == (None, None)
    assert list(as_table("smoke", [first]).columns[3].cells) == ["too short"]
    with pytest.raises(UsageError, match="surfels 400 against 300"):
        list(compared(size, {**other, "surfels": 300}, paired=False))
    with pytest.raises(UsageError, match="differ in cpu"):
        require_comparable(record, {**record, "machine": {**record["machine"], "cpu": "another"}})


def test_a_history_has_a_line_for_each_time_and_no_name_of_the_host(
    measured: tuple[Path, Path], tmp_path: Path
) -> None:
    (line,) = read_history(measured[1])
    record = read_record(measured[0])
    row = record["sizes"]["smoke"]["rows"][0]
    for name, each in record["yardsticks"].items():
        assert line["ratios"]["smoke"][row["title"]][name] == pytest.approx(row["median"] / each["median"], rel=1e-3)
    assert record["machine"]["cpu"] in line["machine"]
    again = tmp_path / "history.jsonl"
    append(again, line)
    append(again, {**line, "commit": "f" * 40})
    assert [each["commit"] for each in read_history(again)] == [line["commit"], "f" * 40]
    table = table_of(again)
    assert any(f"| {line['date'][:10]} ffffff" in each for each in table)
    again.write_text(again.read_text() + "{}\n")
    before = again.read_bytes()
    with pytest.raises(DataError, match="line 3 of"):
        append(again, line)
    assert again.read_bytes() == before


@pytest.mark.parametrize(
    ("wrong", "code", "said"),
    [
        (["--sizes", "huge"], 2, "unknown size 'huge'"),
        (["--method", "nobody"], 2, "unknown method 'nobody'"),
        (["--compare", "nowhere.json"], 3, "there is no record nowhere.json"),
        (["--against", "."], 2, "is no checkout of this project"),
        (["--against", ".", "--history", "h.jsonl"], 2, "--history does not go with --against"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_measured(
    wrong: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "steps", *wrong]) == code
    assert said in capsys.readouterr().err


DOCUMENT = ROOT / "docs" / "performance.md"


def test_the_document_shows_what_was_stored() -> None:
    files = sorted((ROOT / "docs" / "performance").glob("*.json*"))
    assert {file.stem for file in files} >= {"steps", "growth", "history"}
    text = DOCUMENT.read_text()
    assert with_tables(text, {file.stem: table_of(file) for file in files}) == text, (
        "python -m radiogs_bench.lab.steps.document docs/performance.md docs/performance/*.json*"
    )


def test_parts_are_printed_largest_first() -> None:
    """Stored records have them by name."""
    assert (
        parts_said({"density, forward": 0.1, "tracing, forward": 0.7, "z": 0.2}, 2) == "tracing, forward 70 %, z 20 %"
    )


def test_a_document_without_a_place_is_an_error() -> None:
    with pytest.raises(DataError, match="no place for 'growth'"):
        with_tables("# Performance\n", {"growth": []})


def test_times_below_a_clock_tick_have_no_trend(measured: tuple[Path, Path], tmp_path: Path) -> None:
    (line,) = read_history(measured[1])
    title = next(iter(line["ratios"]["smoke"]))
    line["ratios"]["smoke"][title] = dict.fromkeys(line["yardsticks"], 0.0)
    path = tmp_path / "history.jsonl"
    append(path, line)
    append(path, line)
    (row,) = (text for text in table_of(path) if title in text)
    assert row.endswith("| 0 | 0 |  |")
