"""A small capture without its masks, which the tests of captures change."""

import shutil
from pathlib import Path

import pytest

from captured import write_capture


@pytest.fixture(scope="session")
def whole_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_capture(tmp_path_factory.mktemp("whole") / "capture", every=4)


@pytest.fixture
def capture(whole_capture: Path, tmp_path: Path) -> Path:
    """12 photos with poses in COLMAP's text files; masks lie in ``kept_masks`` beside the folder."""
    folder = Path(shutil.copytree(whole_capture, tmp_path / "capture"))
    shutil.move(folder / "masks", tmp_path / "kept_masks")
    return folder
