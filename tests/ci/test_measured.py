"""The list of records that this checkout would compute otherwise, and the renewal of a record."""

import subprocess
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from ci_scripts import script
from radiogs_bench.results.records import write_record

COMMAND = "radiogs-bench run ablations --preset smoke --scenes corner --rows ours,no-rad"


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    module = script("measured")
    monkeypatch.setattr(module, "RECORDS", tmp_path)
    return module


def made(keys: dict[str, str], date: str = "2026-11-28") -> Any:
    return {"origin": {"Command": COMMAND, "Commit": "abc", "Date": date}, "recipe": "recommended", "keys": keys}


def test_a_record_is_current_until_the_key_of_a_cell_changes(
    measured: ModuleType, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = measured.planned_keys(made({}), str(tmp_path / "out"))
    assert set(keys) == {"corner ours seed 0", "corner no-rad seed 0"}
    monkeypatch.setattr(measured, "planned_keys", lambda run, folder: keys)
    write_record(tmp_path / "b.json", [made(keys)])
    assert measured.listed() == 0
    write_record(tmp_path / "a.json", [made({**keys, "corner ours seed 0": "other"}, "2026-11-27")])
    assert measured.listed() == 1
    assert capfd.readouterr().out.splitlines()[-2:] == [
        "2026-11-27  abc  a, recommended: 1 of 2 cells would be computed otherwise, such as corner ours seed 0",
        "2026-11-28  abc  b, recommended: current",
    ]


def test_a_command_that_no_longer_runs_makes_its_record_stale(
    measured: ModuleType, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_record(tmp_path / "a.json", [made({"corner ours seed 0": "key"})])

    def failing(run: Any, folder: str) -> dict[str, str]:
        raise subprocess.CalledProcessError(2, "run", stderr="error: unknown suite 'ablations'\nThere are: none\n")

    monkeypatch.setattr(measured, "planned_keys", failing)
    assert measured.listed() == 1
    assert "its command fails: error: unknown suite 'ablations'\n" in capfd.readouterr().out


def test_a_record_without_keys_or_with_fewer_cells_than_its_command_is_stale(measured: ModuleType) -> None:
    assert measured.staleness({}, {"one": "1"}) == "it does not say which cells it holds"
    assert measured.staleness({"one": "1"}, {"one": "1", "two": "2"}) == "its command has further cells"


def test_a_record_is_made_anew_by_its_own_commands(
    measured: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_record(tmp_path / "two.json", [made({}), made({})])
    ran: list[list[str]] = []
    monkeypatch.setattr(measured, "ran", lambda words: ran.append([*words]) or 0)
    assert measured.made_anew("two") == 0
    folders = ["out/measured/two/0", "out/measured/two/1"]
    assert [words[-2:] for words in ran[:2]] == [["--out", folder] for folder in folders]
    assert ran[0][:2] == ["run", "ablations"]
    assert ran[2][:4] == ["record", *folders, "--to"]
    monkeypatch.setattr(measured, "ran", lambda words: 3)
    assert measured.made_anew("two") == 3
