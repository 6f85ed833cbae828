"""No command writes through a link in the folder that it was given."""

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import radiogs_baselines
import radiogs_bench
import radiogs_reports
from radiogs.showing import TrainedRadioGS
from radiogs_bench.cli import main
from radiogs_bench.store.folder import FOLDERS, Store
from radiogs_core.errors import UsageError
from radiogs_datasets.image_files import write_hdr

VIEW = "view {model} --frames 2 --size 16"
RENDER = "render {model} --relight"
RELIGHT = "relight {model} --envmap {model}/dim.hdr --mode surfels --turntable 2"
TRAIN = "train convex --preset smoke --out {model}"
MESH = "export {model} --mesh --voxel 0.1"
SURFELS = "export {model} --to 3dgs-ply"
LAYOUT = "export {model} --layout-of gs-ir"

WRITTEN = {
    VIEW: ("figures/surfels.html", "figures/surfels.png", "figures/surfels.gif"),
    RENDER: ("render/environment.exr", "render/image/test_000.png", "render/normal/test_000.exr"),
    RELIGHT: ("relight/surfels/relit/dim/test_000.png", "relight/surfels/relit/dim/relit.gif"),
    TRAIN: ("surfels.ply", "environment.exr", "trained.json"),
    MESH: ("mesh.ply", "mesh.json"),
    SURFELS: ("3dgs.ply",),
}
FOLDERS_OF = {
    VIEW: ("figures",),
    RENDER: ("render", "render/image"),
    RELIGHT: ("relight", "relight/surfels", "relight/surfels/relit"),
    LAYOUT: ("gs-ir",),
}


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained")
    assert main(TRAIN.format(model=folder).split()) == 0
    write_hdr(folder / "dim.hdr", np.full((8, 16, 3), 0.05, np.float32))
    return folder


@pytest.fixture
def model(trained: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(trained, tmp_path / "model"))


@pytest.mark.parametrize("command", WRITTEN)
def test_a_link_in_the_place_of_a_file_is_replaced(command: str, model: Path, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    for name in WRITTEN[command]:
        (model / name).parent.mkdir(parents=True, exist_ok=True)
        (model / name).unlink(missing_ok=True)
        (model / name).symlink_to(victim)
    assert main(command.format(model=model).split()) == 0
    assert victim.read_text() == "mine"
    assert not [name for name in WRITTEN[command] if (model / name).is_symlink()]


def test_exports_of_methods_are_not_written_through_links(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NumPy, as most libraries, writes through one."""

    def export(self: TrainedRadioGS, folder: Path) -> list[Path]:
        np.save(folder / "local.npy", np.zeros(3))
        return [folder / "local.npy"]

    victim = tmp_path / "victim"
    victim.write_text("mine")
    (model / "local.npy").symlink_to(victim)
    monkeypatch.setattr(TrainedRadioGS, "export", export)
    assert main(TRAIN.format(model=model).split()) == 0
    assert victim.read_text() == "mine"
    assert np.load(model / "local.npy").shape == (3,)
    assert not list(model.glob(".export-*"))


@pytest.mark.parametrize(("command", "name"), [(each, name) for each, names in FOLDERS_OF.items() for name in names])
def test_a_folder_that_is_a_link_is_refused(
    command: str, name: str, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "elsewhere").mkdir()
    (model / name).parent.mkdir(parents=True, exist_ok=True)
    (model / name).symlink_to(tmp_path / "elsewhere")
    assert main(command.format(model=model).split()) == 2
    assert f"{name} is a link to" in capsys.readouterr().err
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_model_s_folder_that_is_a_link_is_worked_in(trained: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(shutil.copytree(trained, tmp_path / "disk"))
    assert main(VIEW.format(model=tmp_path / "link").split()) == 0
    assert (tmp_path / "disk" / "figures" / "surfels.png").is_file()


@pytest.mark.parametrize("name", FOLDERS)
def test_no_folder_of_a_store_is_a_link(name: str, tmp_path: Path) -> None:
    (tmp_path / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UsageError, match=f"{name} is a link"):
        Store(tmp_path)


def test_a_workspace_is_no_link(tmp_path: Path) -> None:
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "key").symlink_to(tmp_path)
    with pytest.raises(UsageError, match="key is a link"):
        Store(tmp_path).workspace("key")


WRITES = {"save", "savez", "savez_compressed", "savefig", "write_text", "write_bytes"}
METHODS = "export"
"""A method's own ``export`` writes into a new folder (``runs/trained_folder.py``)."""


def functions_that_write() -> Iterator[tuple[str, str]]:
    """Place and text of each function that writes a file by itself, and not into memory."""
    for package, rooms in ((radiogs_bench, ("cli", "export")), (radiogs_reports, ("",)), (radiogs_baselines, ("",))):
        for path in (path for room in rooms for path in (Path(package.__path__[0]) / room).rglob("*.py")):
            text = path.read_text()
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.FunctionDef) and any(map(writes, ast.walk(node))):
                    whole = str(ast.get_source_segment(text, node))
                    if "BytesIO" not in whole:
                        yield f"{path}: {node.name}", whole


def writes(node: ast.AST) -> bool:
    """Whether a call writes a file: by its name, or by the mode that it opens one with."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
        return False
    modes = [each.value for each in node.args if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    return node.func.attr in WRITES or (node.func.attr == "open" and any(set("wax") & set(mode) for mode in modes))


def test_every_function_that_writes_a_file_asks_for_a_fresh_path() -> None:
    found = dict(functions_that_write())
    assert len(found) > 10
    assert not [place for place, text in found.items() if "fresh(" not in text and not place.endswith(f": {METHODS}")]
