"""The scenes that a suite is run on."""

from collections.abc import Sequence
from pathlib import Path

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene, scene_names
from radiogs_datasets.layouts.inspection import shown
from radiogs_datasets.options import AS_STORED, SceneOptions

from .suite import Suite


def own_scenes(suite: Suite) -> Sequence[str]:
    """The scenes of a suite. Raises DataError if they are not here and have to be downloaded."""
    absent = [name for name in suite.scenes if not Path(name).is_dir()] if suite.download else []
    if absent:
        raise DataError(
            f"suite '{suite.name}' needs scenes that are not here: {shown(absent)}",
            f"They do not come with the package. {suite.download}",
            "Run this in the folder that holds them, or say where they are:  radiogs-bench run"
            f" {suite.name} --scenes PATH/{suite.scenes[0]},PATH/{suite.scenes[-1]}",
        )
    return suite.scenes


def load_scenes(wanted: Sequence[str], options: SceneOptions = AS_STORED) -> dict[str, Scene]:
    """Scenes by their own names, opened as the options say.

    Raises DataError for a missing scene, UsageError if two have the same name.
    """
    scenes: dict[str, Scene] = {}
    for each in wanted:
        scene = load_scene(each, options=options)
        if scene.name in scenes:
            raise UsageError(
                f"two scenes are called '{scene.name}'",
                "Their rows in a table could not be told apart.",
                "Rename one of the folders, or run them into folders of their own with --out.",
            )
        scenes[scene.name] = scene
    return scenes


def place_of(name_or_path: str) -> str:
    """A scene's name or absolute path, valid in another working folder."""
    return name_or_path if name_or_path in scene_names() else str(Path(name_or_path).resolve())
