"""``export --to 3dgs-ply``, ``2dgs-ply`` and ``supersplat``: written from a run, and read by SuperSplat's converter."""

import json
import os
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
import pytest
from plyfile import PlyData

from bench.fake_method import FakeSweep, asked, write_sweep
from radiogs_bench.cli import export, main
from radiogs_bench.export import mesh_files
from radiogs_bench.export.trained_surfels import surfels_in
from radiogs_bench.store.folder import Store
from radiogs_core.surfels import viewer_files

ROOT = Path(__file__).parents[3]
CONVERTER = shutil.which("splat-transform", path=f"{ROOT / 'node_modules/.bin'}{os.pathsep}{os.environ['PATH']}")
needs_converter = pytest.mark.skipif(
    CONVERTER is None, reason="needs node, and SuperSplat's converter: npm install @playcanvas/splat-transform"
)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of which the second row alone is trained."""
    request = asked()
    cells = request.cells
    write_sweep(Store(tmp_path), request.manifest())
    FakeSweep(tmp_path).run([cells[1][1]])
    return tmp_path


@pytest.mark.parametrize("form", viewer_files.FORMS)
def test_the_surfels_of_a_row_are_written(form: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(run), "--to", form, "--row", "no-rad"]) == 0
    file = run / f"{form.removesuffix('-ply')}.ply"
    assert f"{file}: 4 surfels" in capsys.readouterr().out
    rows = PlyData.read(str(file))["vertex"].data
    if form != "supersplat":
        assert np.stack([rows[name] for name in "xyz"], -1) == pytest.approx(surfels_in(run, "no-rad").centre.numpy())


def test_a_row_without_a_model_an_unknown_row_and_an_unknown_form_are_refused(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(run), "--to", "3dgs-ply", "--row", "ours"]) == 3
    assert "no model is trained" in capsys.readouterr().err
    assert main(["export", str(run), "--to", "3dgs-ply", "--row", "our"]) == 2
    assert "no row 'our'" in capsys.readouterr().err
    assert main(["export", str(run), "--to", "3dgs"]) == 2
    assert "Did you mean '3dgs-ply'?" in capsys.readouterr().err


def test_the_command_line_knows_every_form() -> None:
    assert get_args(export.Form)[-5:] == (*viewer_files.FORMS, *mesh_files.SUFFIX)


@needs_converter
def test_the_converter_of_supersplat_reads_every_value(run: Path) -> None:
    assert main(["export", str(run), "--to", "3dgs-ply"]) == 0
    convert(run / "3dgs.ply", run / "3dgs.csv")
    stored, read = PlyData.read(str(run / "3dgs.ply"))["vertex"].data, pd.read_csv(run / "3dgs.csv")
    assert len(read) == 4
    for name in viewer_files.OF_3DGS:
        assert read[name].to_numpy() == pytest.approx(stored[name], rel=1e-6), name


@needs_converter
def test_in_the_world_of_supersplat_the_scene_stands_upright_and_as_bright_as_on_a_display(run: Path) -> None:
    assert main(["export", str(run), "--to", "supersplat"]) == 0
    convert(run / "supersplat.ply", run / "s.glb")
    model, data = glb(run / "s.glb")
    attributes = model["meshes"][0]["primitives"][0]["attributes"]
    bounds = model["accessors"][attributes["POSITION"]]
    height = surfels_in(run, None).centre[:, 2]
    assert bounds["min"][1] == pytest.approx(float(height.min()), abs=1e-5)
    assert bounds["max"][1] == pytest.approx(float(height.max()), abs=1e-5)
    constant = model["accessors"][attributes["KHR_gaussian_splatting:SH_DEGREE_0_COEF_0"]]
    view = model["bufferViews"][constant["bufferView"]]
    found = np.frombuffer(data, "<f4", 12, view.get("byteOffset", 0) + constant.get("byteOffset", 0)).reshape(4, 3)
    rows = PlyData.read(str(run / "supersplat.ply"))["vertex"].data
    assert found == pytest.approx(np.stack([rows[f"f_dc_{channel}"] for channel in range(3)], -1))


def convert(source: Path, target: Path) -> None:
    done = subprocess.run(
        [str(CONVERTER), "--quiet", "--overwrite", str(source), str(target)],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert target.exists()


def glb(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary part of a GLB file."""
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    return json.loads(content[20 : 20 + length]), content[28 + length :]
