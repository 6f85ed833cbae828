"""Folders and suites of strangers, beyond the audit's (docs/reliability.md, "Attacks of our own")."""

import io
import json
import os
import shutil
import socket
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from bench.flips import COMMANDS, WRONG, commands_on, finished
from bench.own_suite import WHOLE
from radiogs_bench.cli import main
from radiogs_bench.errors import StoreError
from radiogs_bench.export.mesh import Mesh, write_mesh
from radiogs_bench.store.atomic import write_atomically
from radiogs_bench.store.claim import claim
from radiogs_bench.store.folder import Store
from radiogs_bench.store.pace import pace_of
from radiogs_bench.store.schema import MetricValue
from radiogs_bench.store.seal import Broken, sealed
from radiogs_bench.store.shapes import mismatch
from radiogs_bench.store.tensor_file import packed, read_tensors
from radiogs_core.surfels.ply import write_ply
from radiogs_reports.made_files import BEGUN, begin_record, recorded
from radiogs_reports.maps import MOST_BYTES, read_maps
from scenes import surfels_facing


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    path = tmp_path / "victim"
    path.write_text("mine")
    return path


def test_a_lock_that_is_a_link_is_not_written_through(victim: Path, tmp_path: Path) -> None:
    """``report`` on somebody's folder wrote the process's number over the file that the link leads to."""
    (tmp_path / "out" / "locks").mkdir(parents=True)
    (tmp_path / "out" / "locks" / "summary").symlink_to(victim)
    with pytest.raises(StoreError, match="cannot write"), claim(tmp_path / "out" / "locks" / "summary"):
        pass
    with pytest.raises(StoreError, match="cannot write"), Store(tmp_path / "out").patient_claim("summary"):
        pass
    assert victim.read_text() == "mine"


def test_a_temporary_file_that_is_a_link_is_not_written_through(victim: Path, tmp_path: Path) -> None:
    (tmp_path / ".sweep.json.tmp").symlink_to(victim)
    write_atomically(tmp_path / "sweep.json", b"new")
    assert (victim.read_text(), (tmp_path / "sweep.json").read_text()) == ("mine", "new")
    assert not (tmp_path / "sweep.json").is_symlink()


def test_models_and_meshes_are_not_written_through_links(victim: Path, tmp_path: Path) -> None:
    (tmp_path / "surfels.ply").symlink_to(victim)
    (tmp_path / "mesh.ply").symlink_to(victim)
    write_ply(surfels_facing(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])), tmp_path / "surfels.ply")
    write_mesh(Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)), tmp_path / "mesh.ply")
    assert victim.read_text() == "mine"


def test_arrays_that_grow_beyond_memory_are_refused_unread(tmp_path: Path) -> None:
    """An archive of a few megabytes, named and sealed by a cell, may claim any size."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("render/image.npy", b"")
    content = bytearray((tmp_path / "a.npz").read_bytes())
    place = content.index(b"PK\x01\x02")
    content[place + 24 : place + 28] = (MOST_BYTES - 1).to_bytes(4, "little")
    (tmp_path / "a.npz").write_bytes(content)
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as archive:
        archive.writestr("render/more.npy", b"12")
    with pytest.raises(ValueError, match="unpacks to more than"):
        read_maps(tmp_path / "a.npz")


@pytest.mark.parametrize(("kind", "attributes"), [(zipfile.ZIP_STORED, 0), (zipfile.ZIP_DEFLATED, 0), (0, 0x10)])
def test_tensors_are_refused_whose_parts_are_compressed_or_marked_as_folders(
    kind: int, attributes: int, tmp_path: Path
) -> None:
    """torch stores parts as they are: a compressed one was made to grow, and of a folder it reads nothing."""
    with zipfile.ZipFile(io.BytesIO(packed("stages/a", {"x": torch.ones(1 << 20)}))) as whole:
        parts = {part.filename: whole.read(part) for part in whole.infolist()}
    with zipfile.ZipFile(tmp_path / "a.pt", "w") as archive:
        for name, content in parts.items():
            part = zipfile.ZipInfo(name)
            part.external_attr = attributes
            archive.writestr(part, content, kind)
    if (kind, attributes) == (zipfile.ZIP_STORED, 0):
        assert bool((read_tensors(tmp_path / "a.pt", "stages/a", torch.device("cpu"))["x"] == 1).all())
    else:
        with pytest.raises(Broken, match="compressed or marked"):
            read_tensors(tmp_path / "a.pt", "stages/a", torch.device("cpu"))


class Executed:
    """A pickle that runs code when it is loaded."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


def test_no_pickle_is_executed(tmp_path: Path) -> None:
    torch.save({"stored_as": "stages/a", "content": {"x": Executed(tmp_path / "made")}}, tmp_path / "a.pt")
    with pytest.raises(Broken):
        read_tensors(tmp_path / "a.pt", "stages/a", torch.device("cpu"))
    assert not (tmp_path / "made").exists()
    torch.load(tmp_path / "a.pt", weights_only=False)
    assert (tmp_path / "made").exists(), "the file is one that would do harm"


@pytest.fixture(scope="module")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    finished(folder)
    return folder


@pytest.fixture
def run(finished_run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished_run, tmp_path / "run"))


def with_pipe(path: Path) -> None:
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def with_device(path: Path) -> None:
    path.unlink(missing_ok=True)
    path.symlink_to("/dev/zero")


def with_socket(path: Path) -> None:
    path.unlink(missing_ok=True)
    here = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(f"/proc/self/fd/{here}/{path.name}")
    os.close(here)


def with_holes(path: Path) -> None:
    path.unlink(missing_ok=True)
    with path.open("wb") as file:
        file.truncate(3 << 30)


@pytest.mark.parametrize("put", [with_pipe, with_device, with_socket, with_holes])
@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("sweep.json", "status"),
        ("sweep.json", "report"),
        ("cells/*[0-9a-f].json", "status"),
        ("cells/*[0-9a-f].json", "verify"),
        ("cells/*.npz", "report"),
        ("cells/*.npz", "verify"),
        ("reports.txt", "report"),
        ("trained.json", "render"),
        ("stages/*.pt", "verify"),
    ],
)
def test_irregular_and_too_large_files_are_refused_unread(
    name: str, command: str, put: Callable[[Path], None], run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack results_folder_pipes: these hung, or took all memory."""
    path = sorted(each for each in run.glob(name) if ".failed." not in each.name)[0]
    put(path)
    more = ["--no-pictures"] if command == "report" else []
    if put is with_device and name == "reports.txt":  # a link where a report is written is replaced
        assert main([command, str(run), *more]) == 0
        assert not path.is_symlink()
        return
    assert main([command, str(run), *more]) == 3
    said = "".join(capsys.readouterr())
    assert path.name in said
    assert "Traceback" not in said


@pytest.mark.parametrize("put", [with_pipe, with_device, with_holes])
def test_a_lock_or_a_pace_that_is_no_regular_file_is_not_waited_for(put: Callable[[Path], None], run: Path) -> None:
    (run / "locks").mkdir(exist_ok=True)
    key = Store(run).result_keys()[0]
    put(run / "locks" / f"{key}.pace")
    assert pace_of(Store(run), key) is None
    assert main(["status", str(run)]) == 0


@pytest.mark.parametrize("content", [b"\xff", b"no digest  a\n"])
def test_a_record_of_reports_that_is_damaged_is_named(
    content: bytes, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack reports_txt_byte: every later command ended in a traceback."""
    (run / "reports.txt").write_bytes(content)
    assert main(["report", str(run), "--no-pictures"]) == 3
    assert f"{run / 'reports.txt'} is damaged; delete it" in capsys.readouterr().err
    (run / "reports.txt").unlink()
    assert main(["report", str(run), "--no-pictures"]) == 0


def test_a_record_of_reports_that_is_a_folder_is_named(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / "reports.txt").unlink()
    (run / "reports.txt").mkdir()
    assert main(["report", str(run), "--no-pictures"]) == 3
    assert str(run / "reports.txt") in capsys.readouterr().err


def sealed_again(path: Path, place: tuple[str, ...], value: object) -> None:
    """Put a value into a stored file, with a seal that agrees."""
    stored = json.loads(path.read_bytes())
    holder = stored
    for name in place[:-1]:
        holder = holder[name]
    holder[place[-1]] = value
    path.write_text(json.dumps(sealed(stored)))


@pytest.mark.parametrize(
    ("place", "value"), [(("scene",), 7), (("variant",), [1]), (("method",), ["x"]), (("seed",), True)]
)
def test_a_model_s_fields_of_another_type_are_named(
    place: tuple[str, ...], value: object, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack trained_types."""
    sealed_again(run / "trained.json", place, value)
    assert main(["render", str(run)]) == 3
    said = capsys.readouterr().err
    assert f"{run / 'trained.json'} is damaged: {place[0]} is" in said


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("metrics",), None),
        (("metrics",), []),
        (("metrics", "nvs/psnr", "value"), "x"),
        (("metrics", "nvs/psnr"), {"reason": None, "views": []}),
        (("work",), []),
        (("seconds", "evaluate"), None),
        (("seconds",), {"evaluate": "x"}),
        (("sessions",), []),
        (("sessions", "evaluate"), [{"date": "", "git": None, "versions": {}, "machine": {}, "peak_memory_bytes": {}}]),
        (("trail",), None),
    ],
)
def test_a_result_with_a_value_of_another_type_is_set_aside_by_name(
    place: tuple[str, ...], value: object, run: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Attack gate_types, as the store reads it."""
    key = Store(run).result_keys()[0]
    sealed_again(run / "cells" / f"{key}.json", place, value)
    assert Store(run).result(key) is None
    assert ".".join(place).split("/")[0] in caplog.text
    assert list((run / "aside").iterdir())


def test_a_number_beyond_every_range_is_named(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Found by damaged stored files: a whole number beyond float64 in a sealed variant."""
    variant = json.loads((run / "trained.json").read_bytes())["variant"]
    assert "side" in variant["geometry"]["start"]["sweep"]
    sealed_again(run / "trained.json", ("variant", "geometry", "start", "sweep", "side"), 10**400)
    assert main(["render", str(run)]) == 2
    assert "is not one or above" in capsys.readouterr().err


def test_a_value_has_the_type_that_is_declared() -> None:
    assert mismatch({"value": 1, "reason": None, "views": [1.5, None]}, MetricValue) == ""
    for wrong in (None, [], {}, {"value": True, "reason": None, "views": []}):
        assert mismatch(wrong, MetricValue) != ""
    assert mismatch({"value": 1, "reason": None, "views": [1, "x"]}, MetricValue) == "views[1] is 'x', not a number"
    assert mismatch({"value": 10**400, "reason": None, "views": []}, MetricValue).startswith("value is 1000")


@pytest.mark.parametrize("command", ["run", "method"])
def test_a_suite_s_keys_are_not_nested_without_bound(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack toml_dotted_key: 7.5 GB for a file of 200 kB."""
    file = tmp_path / "deep.toml"
    file.write_text("a." * 100_000 + "b = 1\n")
    words = ["run", str(file), "--list"] if command == "run" else ["methods", str(file)]
    assert main(words) == 2
    assert "a key has more than 32 parts" in capsys.readouterr().err


def test_a_suite_has_no_more_bytes_and_rows_than_can_be_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Attack toml_100000_rows: quadratic time."""
    file = tmp_path / "rows.toml"
    head = 'name="hh"\ntitle="H"\nreference="r0"\ncolumns=["nvs/psnr"]\n'
    file.write_text(head + "".join(f'[[rows]]\nkey="r{i}"\ntext="R{i}"\n' for i in range(40_000)))
    assert main(["run", str(file), "--list"]) == 3
    assert "RADIOGS_BENCH_LARGEST_TOML" in capsys.readouterr().err
    monkeypatch.setenv("RADIOGS_BENCH_LARGEST_TOML", str(1 << 24))
    assert main(["run", str(file), "--list"]) == 2
    assert "40000 rows" in capsys.readouterr().err


def test_reports_of_a_run_that_was_killed_while_it_wrote_them_are_recognised(run: Path) -> None:
    """Attack killed_report_leaves_figures: leftover figures stayed among the next suite's for good."""
    for name in ("figures/theirs.png", "tables/theirs.csv"):
        (run / name).parent.mkdir(exist_ok=True)
        (run / name).write_text("a stranger's")
    begin_record(run, "killed")
    left = ("figures/killed-a.png", "tables/killed.csv", "killed.csv", "killed_table.tex", "killed.md")
    for name in left:
        (run / name).write_text("half")
    assert set(left) <= recorded(run).keys()
    assert not {"figures/theirs.png", "tables/theirs.csv"} & recorded(run).keys()
    assert main(["report", str(run), "--no-pictures"]) == 0
    assert not (run / BEGUN).exists()
    assert not (run / "figures/killed-a.png").exists()
    assert not (run / "tables/killed.csv").exists()
    assert (run / "figures/theirs.png").exists()
    assert (run / "tables/theirs.csv").exists()


@pytest.mark.slow
def test_damaged_files_under_every_command_end_without_a_traceback(finished_run: Path, tmp_path: Path) -> None:
    found = commands_on(finished_run, 60, 0, tmp_path)
    assert sum(found.values()) == 60 * len(COMMANDS)
    assert not set(WRONG) & found.keys(), found


@pytest.mark.parametrize("text", [r"\u001b[2J", r"\u202e", r"a\nb", r"\u0000"])
@pytest.mark.parametrize("field", ["title", "text", "latex", "key"])
def test_text_of_a_suite_cannot_command_the_terminal(
    field: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {"title": "Mine & yours", "text": "50 % of #1", "latex": "$b$", "key": "b"}[field]
    assert WHOLE.count(f'{field} = "{before}"') == 1
    file = tmp_path / "suite.toml"
    file.write_text(WHOLE.replace(f'{field} = "{before}"', f'{field} = "{text}"'))
    assert main(["run", str(file), "--dry-run", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert field in said
    assert all(each.isprintable() for each in said.replace("\n", ""))


def test_a_folder_of_results_that_is_a_link_is_worked_in(tmp_path: Path) -> None:
    """Links to folders are the user's own: large results often lie on another disk."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "disk")
    write_atomically(tmp_path / "out" / "a.json", b"1")
    assert (tmp_path / "disk" / "a.json").read_bytes() == b"1"
    shutil.rmtree(tmp_path / "disk")
