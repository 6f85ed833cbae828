"""docs/store.md says every key that a stored file has."""

import json
import re
from pathlib import Path

from bench.fake_method import FakeSweep, fake_cell
from radiogs_bench.store.schema import RESULT_SCHEMA, Failure, MetricValue, Result, Session, StageName

DOCUMENT = (Path(__file__).parents[3] / "docs" / "store.md").read_text()


def section(title: str) -> str:
    return DOCUMENT.split(f"{title}", 1)[1].split("\n#", 1)[0]


def test_the_version_is_the_one_that_is_written() -> None:
    assert f"## A cell: `{RESULT_SCHEMA}`" in DOCUMENT
    assert f"| `{RESULT_SCHEMA.removeprefix('radiogs-bench/')}` |" in section("## Versions")


def test_the_document_lists_exactly_the_keys_of_a_result() -> None:
    lines = re.findall(r"^\| `(\w+)` \|", section("## A cell"), re.MULTILINE)
    assert sorted(lines) == sorted(Result.__annotations__)
    lines = re.findall(r"^\| `(\w+)` \|", section("### A session"), re.MULTILINE)
    assert sorted(lines) == sorted(Session.__annotations__)
    for key in (*MetricValue.__annotations__, *StageName.__annotations__):
        assert f"`{key}`" in section("## A cell")
    for key in Failure.__annotations__:
        assert f"`{key}`" in section("## A failure")


def test_a_record_has_the_documented_keys_and_a_peak_for_each_stage(tmp_path: Path) -> None:
    FakeSweep(tmp_path).run([fake_cell()])
    (file,) = (tmp_path / "cells").glob("*.json")
    stored = json.loads(file.read_text())
    assert stored.keys() == Result.__annotations__.keys()
    for name in stored["cell"]:
        assert f"`{name}`" in section("## A cell")
    assert stored["sessions"].keys() == {"initialise", "invert", "evaluate"}
    for stage, sessions in stored["sessions"].items():
        for session in sessions:
            trained = {"yardstick"} if stage != "evaluate" else set()
            assert session.keys() == Session.__required_keys__ | trained
            assert session["peak_memory_bytes"]["host"] > 2**20
            for name in session["machine"]:
                assert f"`{name}`" in section("### A session")
