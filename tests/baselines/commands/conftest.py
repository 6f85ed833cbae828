"""The stand-in code, and results of every layout for it to lay out."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from public_outputs import WRITERS, Maps, noisy
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene


@pytest.fixture(autouse=True)
def _stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STAND_IN_HOME", str(Path(__file__).parent))
    monkeypatch.setenv("STAND_IN_PYTHON", sys.executable)


@pytest.fixture(scope="session")
def convex() -> Scene:
    return load_scene("convex")


@pytest.fixture(scope="session")
def predicted(convex: Scene) -> dict[str, Maps]:
    return noisy(convex)


@pytest.fixture(scope="session")
def pantry(predicted: dict[str, Maps], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A folder with the results of a layout."""
    root, made = tmp_path_factory.mktemp("pantry"), set()

    def folder(layout: str) -> Path:
        if layout not in made:
            WRITERS[layout](root / layout, predicted)
            made.add(layout)
        return root / layout

    return folder
