"""``verify`` finds every damage that readers find, changes nothing, and states what a rerun would take."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import main
from radiogs_bench.results.verify import verify
from radiogs_bench.store.folder import Store
from radiogs_bench.store.seal import sealed, strict_json, write_sealed


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of five cells, three of which share their first stage, with reports and a failure."""
    folder = tmp_path_factory.mktemp("run")
    sweep, request = FakeSweep(folder), asked(1)
    cells = request.cells
    write_sweep(sweep.store, request.manifest())
    sweep.run([cell for _, cell in cells])
    assert main(["report", str(folder)]) == 0
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    return shutil.copytree(made, tmp_path / "run")


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_an_undamaged_folder_is_reported_as_such(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stages = len(list((run / "stages").glob("*.pt")))
    assert main(["verify", str(run)]) == 0
    assert capsys.readouterr().out == f"{2 + 2 * 5 + stages} files are as they were stored, 0 are not\n"


@pytest.mark.parametrize("name", ["sweep.json", "summary.json", "cells/*.json", "cells/*.npz", "stages/*.pt"])
@pytest.mark.parametrize(
    "damage", [lambda content: content[: len(content) // 2], lambda content: b""], ids=["cut short", "empty"]
)
def test_verify_reads_every_kind_of_file_and_moves_none(
    name: str, damage: Callable[[bytes], bytes], run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sorted(run.glob(name))[0]
    path.write_bytes(damage(path.read_bytes()))
    before = files(run)
    assert main(["verify", str(run)]) == 3
    said = capsys.readouterr().out
    assert said.splitlines()[0].startswith(f"{path.relative_to(run)}: ")
    assert ", 1 are not\n" in said
    assert files(run) == before


def test_arrays_that_are_gone_are_found(run: Path) -> None:
    path = sorted((run / "cells").glob("*.npz"))[0]
    path.unlink()
    (finding,) = verify(run).findings
    assert (finding.path, finding.what) == (f"cells/{path.name}", "it is gone")


def test_a_rerun_scores_trained_cells_and_trains_the_others(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store, (scored, trained, *_) = Store(run), [place for place, _ in asked(1).cells]
    took = [result["seconds"] for result in store.results() if result["key"] not in (scored["key"], trained["key"])]
    (run / "cells" / f"{scored['key']}.json").write_bytes(b"")
    (run / "cells" / f"{trained['key']}.npz").unlink()
    (run / "stages" / f"{trained['stages'][-1]}.pt").write_bytes(b"")
    rerun = verify(run).rerun
    assert rerun is not None
    evaluate, invert = (sum(each[stage] for each in took) / 3 for stage in ("evaluate", "invert"))
    assert (rerun.cells, rerun.stages) == (2, 1)
    assert rerun.seconds == pytest.approx(2 * evaluate + invert)
    assert main(["verify", str(run)]) == 3
    assert "would finish 2 cells and train 1 stages for them: about 0 s" in capsys.readouterr().out


def test_files_of_another_version_are_counted_and_no_damage(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = sorted((run / "cells").glob("*.json"))[0]
    content = json.loads(path.read_bytes())
    del content["seal"]
    path.write_bytes(strict_json(content | {"schema": "radiogs-bench/result/5"}))
    assert main(["verify", str(run)]) == 0
    assert "1 files of other versions were left alone" in capsys.readouterr().out


def test_a_damaged_failure_record_is_reported(run: Path) -> None:
    key = sorted((run / "cells").glob("*.json"))[0].stem
    path = run / "cells" / f"{key}.failed.json"
    path.write_bytes(strict_json(sealed({"schema": "radiogs-bench/result/6", "key": key}) | {"key": "other"}))
    assert [each.path for each in verify(run).findings] == [f"cells/{path.name}"]


def test_a_folder_without_a_run_is_explained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(tmp_path)]) == 3
    assert "no run in" in capsys.readouterr().err


RECORD = {"schema": "radiogs-bench/score/1", "scene": "corner", "protocols": {"default": {"nvs/psnr": 15.44}}}


@pytest.mark.parametrize("name", ["score.json", "mine.json"])
def test_records_beside_a_run_are_looked_at(name: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 29: one digit changed in ``score.json`` or ``mesh.json`` was seen by nobody."""
    (run / "notes.json").write_text("{not ours")
    write_sealed(run / name, RECORD)
    whole = (run / name).read_bytes()
    assert main(["verify", str(run)]) == 0
    for damage in (whole.replace(b"15.44", b"95.44"), whole.replace(b'"seal": "', b'"seal": "0'), whole[:-20],
                   whole.replace(b"radiogs-bench", b"radiogs_bench")):  # fmt: skip
        assert damage != whole
        (run / name).write_bytes(damage)
        assert main(["verify", str(run)]) == 3
        assert f"{name}: it" in capsys.readouterr().out.replace("its content does not", "it")


def test_a_folder_of_one_record_can_be_verified(tmp_path: Path) -> None:
    write_sealed(tmp_path / "score.json", RECORD)
    assert main(["verify", str(tmp_path)]) == 0
    (tmp_path / "score.json").write_bytes(b"")
    assert main(["verify", str(tmp_path)]) == 3
