"""One Blender process for all tests that render; they skip, with Blender's complaint, if it is missing."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from radiogs_datasets.blend.process import Blender, blender_failure
from radiogs_datasets.image_files import write_hdr


@pytest.fixture(scope="session")
def blender(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Blender]:
    failure = blender_failure()
    if failure is not None:
        pytest.skip(f"Blender cannot be used here: {failure}")
    with Blender(tmp_path_factory.mktemp("blender") / "log") as process:
        yield process


@pytest.fixture
def lights(tmp_path: Path) -> Path:
    """A folder with a white sky for training, and one bright texel to relight."""
    folder = tmp_path / "lights"
    folder.mkdir()
    write_hdr(folder / "training.hdr", np.ones((16, 32, 3), np.float32))
    spot = np.full((16, 32, 3), 1 / 128, np.float32)
    spot[4, 10] = 128
    write_hdr(folder / "spot.hdr", spot)
    return folder
