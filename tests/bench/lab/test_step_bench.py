"""``bench steps``: times, counts and parts of the time; ratios to an earlier record."""

import importlib.util
import json
import mmap
import re
import time
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest
import torch
from scipy import stats

from bench.fake_method import FAKE
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.lab.kernels.clock import processor_seconds
from radiogs_bench.lab.steps.measure import PARTS, Times, counting, looking, median_of, placed, shares_of
from radiogs_bench.lab.steps.passes import one_pass
from radiogs_bench.lab.steps.record import (
    SCHEMA,
    comparable_sizes,
    frames_said,
    milliseconds,
    ratio_table,
    read_record,
    times_as_fast,
)
from radiogs_bench.lab.steps.sizes import SIZES
from radiogs_bench.lab.steps.subject import ON_SURFACES, OWN_START, subject_of
from radiogs_bench.methods import method
from radiogs_core.errors import UsageError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.kernels.surfel.footprint import frames
from radiogs_datasets import load_scene

ROOT = Path(__file__).parents[3]
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A record of the smallest size."""
    file = tmp_path_factory.mktemp("steps") / "steps.json"
    assert main(["bench", "steps", "--sizes", "smoke", "--passes", "2", "--json", str(file)]) == 0
    return read_record(file)


def test_all_kinds_of_steps_beginnings_of_stages_and_frames_are_measured(record: dict[str, Any]) -> None:
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


def test_a_frame_by_rays_shades_and_one_by_surfels_alone_does_not(record: dict[str, Any]) -> None:
    rows = {row["title"]: row["work"] for row in record["sizes"]["smoke"]["rows"]}
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
    assert main(["bench", "steps", "--help"]) == 0
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
    with looking():
        while time.perf_counter() < until:
            seen.add(processor_seconds())
    assert len(seen) > 1000


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

    with looking() as seconds:
        Traced.apply(torch.ones(1, requires_grad=True)).sum().backward()  # type: ignore[no-untyped-call]
    shares = shares_of([seconds])
    assert shares["tracing, backward"] == pytest.approx(0.75, abs=0.15)
    assert shares["image losses, forward"] == pytest.approx(0.25, abs=0.15)
    assert placed(None) == "other, forward"


def test_page_faults_count_new_memory() -> None:
    times, pages = Times(CPU, counts=False), 4096
    kept = mmap.mmap(-1, pages * mmap.PAGESIZE)

    def touch() -> None:
        for page in range(pages):
            kept[page * mmap.PAGESIZE] = 1

    times(("first",), touch)
    times(("again",), touch)
    assert times.faults["first"][0] >= pages
    assert times.faults["again"][0] < pages / 10


def test_frames_by_rays_are_compared_with_frames_by_surfels() -> None:
    def frames(way: str, seconds: float) -> dict[str, Any]:
        return {"title": f"relighting {way}: a frame", "median": seconds}

    alone, rays = frames("by surfels alone, fine-tuned", 0.01), frames("by rays, split sum", 0.055)
    preparing = {**rays, "title": "relighting by rays, split sum: preparing"}
    assert list(frames_said({"rows": [preparing, rays, alone]})) == [
        "A frame of relighting by rays, split sum takes 5.5 times as long as one of relighting by surfels alone,"
        " fine-tuned."
    ]
    assert list(frames_said({"rows": [rays]})) == []
    assert list(frames_said({"rows": [rays, {**alone, "median": 0.0}]})) == []


def test_operations_of_the_backward_pass_are_counted_too() -> None:
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


def test_records_are_compared_on_one_machine_and_tell_of_other_work(record: dict[str, Any]) -> None:
    size = record["sizes"]["smoke"]
    other = json.loads(json.dumps(size))
    other["rows"][0]["median"] *= 2
    other["rows"][-1]["work"] = {name: 2 * amount for name, amount in other["rows"][-1]["work"].items()}
    ratios, *_, work = (list(column.cells) for column in ratio_table("smoke", size, other).columns[3:])
    assert ratios[0] == "2.00"
    assert work[0] == ""
    assert set(re.findall(r"x ([\d.]+)", work[-1])) == {"0.50"}
    with pytest.raises(UsageError, match="surfels 400 against 300"):
        ratio_table("smoke", size, {**other, "surfels": 300})
    with pytest.raises(UsageError, match="differ in cpu"):
        comparable_sizes(record, {**record, "machine": {**record["machine"], "cpu": "another"}}, ["smoke"])
    with pytest.raises(UsageError, match="has none of these sizes"):
        comparable_sizes(record, record, ["tiny"])
    assert comparable_sizes(record, record, ["smoke", "tiny"]) == {"smoke": size}


def test_a_ratio_above_one_is_faster_now_and_lies_between_the_ends_of_both_intervals() -> None:
    before, now = {"median": 3.0, "low": 2.0, "high": 4.0}, {"median": 2.0, "low": 1.0, "high": 2.5}
    assert times_as_fast(before, now) == ("1.50", "0.80 to 4.00")
    assert times_as_fast({**before, "low": None, "high": None}, now) == ("1.50", "")
    assert times_as_fast(before, {**now, "low": 0.0}) == ("1.50", "")
    assert times_as_fast(before, {**now, "median": 0.0}) == ("too short", "")


def test_an_interval_of_a_median_has_its_stated_coverage() -> None:
    assert median_of([float(each) for each in range(20)]) == {"median": 9.5, "low": 5, "high": 14}
    assert 1 - 2 * stats.binom.cdf(5, 20, 0.5) >= 0.95
    assert 1 - 2 * stats.binom.cdf(6, 20, 0.5) < 0.95
    assert median_of([1.0, 2.0, 3.0, 4.0, 5.0]) == {"median": 3.0, "low": None, "high": None}


@pytest.mark.parametrize(
    ("wrong", "code", "said"),
    [
        (["--sizes", "huge"], 2, "unknown size 'huge'"),
        (["--method", "nobody"], 2, "unknown method 'nobody'"),
        (["--compare", "nowhere.json"], 3, "there is no record nowhere.json"),
    ],
)
def test_wrong_options_are_refused_before_anything_is_measured(
    wrong: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "steps", *wrong]) == code
    assert said in capsys.readouterr().err


def test_the_document_has_lines_of_the_stored_values() -> None:
    text = (ROOT / "docs" / "cost.md").read_text(encoding="utf-8")
    block = text.partition("<!-- measured steps -->")[2].partition("<!-- end of measured -->")[0]
    stored = read_record(ROOT / "docs" / "performance" / "steps.json")
    assert stored["schema"] == SCHEMA
    lines = {}
    for rows in zip(*(stored["sizes"][name]["rows"] for name in ("tiny", "20k")), strict=True):
        lines[rows[0]["title"]] = f"| {rows[0]['title']} | {' | '.join(milliseconds(row['median']) for row in rows)} |"
    shown = [line for line in block.splitlines() if line.startswith("|")][2:]
    titles = [line.split(" | ")[0].removeprefix("| ") for line in shown]
    assert all(line.startswith(lines[title]) for title, line in zip(titles, shown, strict=True))
    assert {"stage 1, initialisation: step", "stage 2, inverse rendering: step"} <= {*titles}
    for name, size in stored["sizes"].items():
        assert f"{name}: {next(frames_said(size))}" in block
    assert stored["git"]["commit"][:7] in block
