"""The stand-in code, and results of every layout for it to lay out."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from baselines.commands.bench import Bench, Cells, Shelf, method_of
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


@pytest.fixture
def shelf(pantry: Callable[[str], Path]) -> Shelf:
    """The argument by which the stand-in lays out the results of a layout."""
    return lambda layout: f"--pantry|{pantry(layout)}"


@pytest.fixture
def cell_of(convex: Scene, tmp_path: Path) -> Cells:
    """A cell of a method's file on the scene, in its own folder."""

    def made(text: str, work: str = "work", scene: Scene = convex, **given: Any) -> Bench:
        return Bench(method_of(tmp_path, text), scene, tmp_path / work, **given)

    return made
