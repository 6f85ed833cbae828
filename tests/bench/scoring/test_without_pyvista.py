"""Without pyvista everything else works, and commands that need it state what to install."""

import sys
from pathlib import Path

import numpy as np
import pytest

from radiogs_bench.export.mesh import Mesh, shape_of
from radiogs_bench.scoring import score_orb
from radiogs_bench.scoring.metrics.surface_distance import pyvista, read_mesh
from radiogs_core.errors import UsageError
from radiogs_datasets import load_scene


@pytest.fixture(autouse=True)
def no_pyvista(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)


def test_a_library_that_cannot_be_loaded_is_explained_with_what_to_install(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as raised:
        read_mesh(tmp_path / "mesh.obj")
    assert "apt-get install libgl1" in raised.value.remedy
    with pytest.raises(UsageError):
        pyvista()


def test_a_mesh_is_exported_without_its_distance_and_a_capture_scored_without_its_shape(tmp_path: Path) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    shape = shape_of(Mesh(corners, np.array([[0, 1, 2]])), load_scene("corner"))
    value = score_orb.shape_distance(tmp_path / "ours.ply", tmp_path / "theirs.obj")
    for reason in (shape["reason"], value.reason):
        assert "apt-get install libgl1" in reason
    assert value.value is None
