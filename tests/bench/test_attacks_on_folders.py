"""Folders and suites of strangers, beyond the audit's (docs/reliability.md, "Attacks of our own")."""

import io
import os
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from bench.own_suite import WHOLE
from radiogs_bench.cli import main
from radiogs_bench.errors import StoreError
from radiogs_bench.export.mesh import Mesh, write_mesh
from radiogs_bench.store.atomic import write_atomically
from radiogs_bench.store.claim import claim
from radiogs_bench.store.folder import Store
from radiogs_bench.store.seal import Broken
from radiogs_bench.store.tensor_file import packed, read_tensors
from radiogs_core.surfels.ply import write_ply
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


def test_tensors_that_are_compressed_are_refused_unread(tmp_path: Path) -> None:
    """torch stores its parts as they are: a compressed one was made to grow."""
    with zipfile.ZipFile(io.BytesIO(packed("stages/a", {"x": torch.zeros(1 << 20)}))) as whole:
        parts = {part.filename: whole.read(part) for part in whole.infolist()}
    for kind in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        with zipfile.ZipFile(tmp_path / "a.pt", "w", kind) as archive:
            for name, content in parts.items():
                archive.writestr(name, content)
        if kind == zipfile.ZIP_STORED:
            assert read_tensors(tmp_path / "a.pt", "stages/a", torch.device("cpu"))["x"].shape == (1 << 20,)
    with pytest.raises(Broken, match="compressed"):
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
