"""Stored files carry seals: a changed digit, a swapped or a missing file is noticed and reported."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.fake_method import CPU, FAKE, FakeSweep, asked
from made_up_run import summary
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs.sweep import read_sweep, state_of
from radiogs_bench.store.folder import Store, product_name
from radiogs_bench.store.keys import content_key
from radiogs_bench.store.seal import SEAL, Broken, OtherSchema, read_sealed, seal_of, sealed, strict_json
from radiogs_core.errors import DataError
from radiogs_reports import summary as reports

SCHEMA = "radiogs-bench/thing/1"


def first_cell(folder: Path) -> Path:
    return sorted((folder / "cells").glob("*.json"))[0]


def changed(path: Path, change: Callable[[dict[str, Any]], None], sealed_again: bool = False) -> None:
    content = json.loads(path.read_bytes())
    change(content)
    path.write_bytes(strict_json(sealed(content) if sealed_again else content))


def another_value(content: dict[str, Any]) -> None:
    content["metrics"]["nvs/psnr"]["value"] += 80.0


def test_sealed_content_is_read_back(tmp_path: Path) -> None:
    content = {"schema": SCHEMA, "value": 0.1 + 0.2, "none": None, "list": [1, "é"]}
    (tmp_path / "f.json").write_bytes(strict_json(sealed(content)))
    assert read_sealed(tmp_path / "f.json", SCHEMA, ("value",)) == content | {SEAL: seal_of(content)}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "not JSON"),
        (b"\xff", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b"[1]", "no JSON object|not a JSON object"),
        (strict_json({"schema": SCHEMA, "value": 1}), "no seal"),
        (strict_json({"schema": SCHEMA, "value": 1, "seal": None}), "does not agree"),
        (b'{"schema": "radiogs-bench/thing/1", "value": NaN, "seal": "0"}', "does not agree"),
        (strict_json(sealed({"schema": SCHEMA, "value": 1}) | {"value": 2}), "does not agree"),
        (strict_json(sealed({"schema": SCHEMA, "value": 1}) | {"schema": "radiogs-bench/thing/2"}), "does not agree"),
        (strict_json(sealed({"schema": SCHEMA})), "lacks value"),
    ],
)
def test_content_that_does_not_agree_with_its_seal_is_broken(content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "f.json").write_bytes(content)
    with pytest.raises(Broken, match=says):
        read_sealed(tmp_path / "f.json", SCHEMA, ("value",))


@pytest.mark.parametrize("older", [{"value": 1}, sealed({"schema": "radiogs-bench/thing/2"})])
def test_a_file_of_another_version_is_no_damage(older: dict[str, Any], tmp_path: Path) -> None:
    """Files of versions before there were seals have none."""
    (tmp_path / "f.json").write_bytes(strict_json({"schema": "radiogs-bench/thing/0", **older}))
    with pytest.raises(OtherSchema, match="thing/1"):
        read_sealed(tmp_path / "f.json", SCHEMA, ())


def test_one_changed_digit_of_a_cell_reaches_no_table(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Audit M6."""
    path = first_cell(run)
    changed(path, another_value)
    for command in (["status"], ["report"], ["export"]):
        assert main([*command, str(run)]) == 0
        said = capsys.readouterr()
        assert f"1 file was found damaged and not used: {run / 'aside'} has {path.name}.0" in said.out
    assert "does not agree with its seal" not in said.err  # it is moved once
    assert not path.exists()
    exported = (run / "export.csv").read_text()
    assert path.stem not in exported
    assert exported.count("nvs/psnr") == 4
    page = (run / "report.html").read_text()
    assert "its results were damaged" in page
    assert "4 of 5 cells finished" in _said(["status", str(run)], capsys)


def test_the_gate_uses_no_damaged_cell(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M6."""
    monkeypatch.setitem(substitutes, FAKE.name, FAKE)
    baseline, cell = tmp_path / "baseline.json", first_cell(run)
    assert main(["gate", str(run), "--baseline", str(baseline), "--update"]) == 0
    changed(cell, lambda content: content["seconds"].update(invert=0.0))
    assert main(["gate", str(run), "--baseline", str(baseline)]) == 3
    assert f"{cell} is not as it was stored: its content does not agree with its seal" in capsys.readouterr().err
    assert cell.exists()


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content["cell"].update(seed=7),
        lambda content: content["cell"]["variant"].update(detach="all"),
        lambda content: content.update(key=content_key({})),
    ],
)
def test_the_key_is_computed_again_from_the_cell(change: Callable[[dict[str, Any]], None], run: Path) -> None:
    """Audit M6: also of a file that was sealed again."""
    path = first_cell(run)
    changed(path, change, sealed_again=True)
    assert Store(run).result(path.stem) is None
    assert (run / "aside" / f"{path.name}.0").exists()


def test_the_result_of_another_cell_is_not_taken(run: Path) -> None:
    one, other = sorted((run / "cells").glob("*.json"))[:2]
    shutil.copy(other, one)
    assert Store(run).result(one.stem) is None
    assert Store(run).result(other.stem) is not None


def test_tensors_under_another_key_are_not_used(run: Path) -> None:
    """Audit M6."""
    one, other = sorted((run / "stages").glob("*.pt"))[:2]
    shutil.copy(other, one)
    assert Store(run).tensors(product_name(one.stem), CPU) is None
    assert (run / "aside" / f"{one.name}.0").exists()
    assert Store(run).tensors(product_name(other.stem), CPU) is not None


def test_a_changed_manifest_is_refused(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Audit M6."""
    changed(run / "sweep.json", lambda content: content.update(protocol="radiogs"))
    for command in ("status", "report", "export"):
        assert main([command, str(run)]) == 3
        assert "does not agree with its seal" in capsys.readouterr().err
    assert not (run / "summary.json").exists()


def test_a_failure_carries_a_seal(run: Path) -> None:
    store, path = Store(run), first_cell(run)
    result = store.result(path.stem)
    words = {"what": "w", "why": "", "remedy": "", "exit_code": 1, "date": ""}
    store.put_failure({name: result[name] for name in ("schema", "key", "scene", "cell")} | words)  # type: ignore
    failed = path.with_suffix(".failed.json")
    changed(failed, lambda content: content.update(what="something else"))
    assert store.failure(path.stem) is None
    assert (run / "aside" / f"{failed.name}.0").exists()


def test_the_reports_and_the_harness_make_the_same_seal(tmp_path: Path) -> None:
    content: dict[str, Any] = {**summary()}
    assert reports.seal_of(content) == seal_of(content)
    (tmp_path / "summary.json").write_bytes(strict_json(sealed(content)))
    assert reports.read_summary(tmp_path)["title"] == content["title"]


def test_no_report_is_made_from_a_changed_summary(tmp_path: Path) -> None:
    """Audit M6."""
    content = sealed(summary())
    content["cells"]["ours"]["nvs/psnr"]["mean"] = 95.44
    (tmp_path / "summary.json").write_bytes(strict_json(content))
    with pytest.raises(ValueError, match="does not agree with its seal"):
        reports.read_summary(tmp_path)


def _said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    main(arguments)
    return capsys.readouterr().out


def spoilt(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    "damage", [spoilt, lambda path: path.write_bytes(b""), lambda path: path.write_bytes(path.read_bytes()[:-50])]
)
def test_damaged_arrays_are_set_aside_and_the_cell_made_again(
    damage: Callable[[Path], None], run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Audit M17."""
    path = first_cell(run).with_suffix(".npz")
    whole = path.read_bytes()
    damage(path)
    assert main(["report", str(run)]) == 0
    assert path.name in capsys.readouterr().out
    assert (run / "aside" / f"{path.name}.0").exists()
    sweep = FakeSweep(run)
    (place,) = [place for place in read_sweep(run)["cells"] if place["key"] == path.stem]
    assert state_of(sweep.store, place).startswith("trained, not scored")
    sweep.run([cell for _, cell in asked(1).cells])
    assert path.read_bytes() == whole
    assert sweep.store.result(path.stem) is not None


def test_missing_arrays_are_reported_and_made_again(run: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Audit M17: their pictures vanished unsaid."""
    path = first_cell(run).with_suffix(".npz")
    path.unlink()
    store = Store(run)
    assert store.result(path.stem) is None
    assert f"{path} is gone" in caplog.text
    assert not store.has_result(path.stem)
    FakeSweep(run).run([cell for _, cell in asked(1).cells])
    assert store.result(path.stem) is not None


def test_arrays_of_another_cell_are_not_taken(run: Path) -> None:
    one, other = sorted((run / "cells").glob("*.npz"))[:2]
    one.write_bytes(other.read_bytes() + b" ")
    store = Store(run)
    assert store.result(other.stem) is not None
    assert store.result(one.stem) is None


def test_a_result_whose_arrays_are_gone_does_not_stand_beside_new_ones(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a reader between the two writes would set the new arrays aside."""
    store, path = Store(run), first_cell(run)
    result = store.result(path.stem)
    assert result is not None
    path.with_suffix(".npz").unlink()
    there: list[bool] = []
    replace = Path.replace

    def looking(source: Path, target: Path) -> Path:
        there.append(path.exists())
        return replace(source, target)

    monkeypatch.setattr(Path, "replace", looking)
    store.put_result(result, {})
    assert there == [False, False]


@pytest.mark.parametrize("name", ["../../victim", "..", "/etc/passwd", "", ".hidden", "a\x00b", "a" * 300])
def test_names_that_lead_out_of_the_folder_are_refused(name: str, run: Path, tmp_path: Path) -> None:
    """Audit M18: a file that was sealed again by whoever wrote the name."""
    victim = tmp_path / "victim.pt"
    victim.write_bytes(b"mine")
    changed(run / "sweep.json", lambda content: content.update(suite=name), sealed_again=True)
    with pytest.raises(DataError, match="no plain file name"):
        read_sweep(run)
    changed(run / "sweep.json", lambda content: content.update(suite="ablations"), sealed_again=True)
    changed(run / "sweep.json", lambda content: content["cells"][0].update(key=name), sealed_again=True)
    with pytest.raises(DataError, match="no plain file name"):
        read_sweep(run)
    with pytest.raises(DataError, match="no plain file name"):
        Store(run).tensors(f"stages/{name}", CPU)
    with pytest.raises(DataError, match="no plain file name"):
        Store(run).result(name)
    assert victim.read_bytes() == b"mine"
