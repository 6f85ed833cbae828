"""The scenes that a suite is run on."""

import os
from collections.abc import Sequence
from pathlib import Path

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import known_names, load_scene
from radiogs_datasets.data_root import data_root, in_data_sets
from radiogs_datasets.layouts.inspection import shown
from radiogs_datasets.options import AS_STORED, SceneOptions
from radiogs_datasets.registry import located

from .data_sets import DOWNLOADS
from .suite import Suite


def own_scenes(suite: Suite) -> Sequence[str]:
    """The scenes of a suite as folders, here or in the root of data. Raises DataError if some are in neither."""
    if not suite.download:
        return suite.scenes
    places = {name: _place(suite, name) for name in suite.scenes}
    absent = [name for name, place in places.items() if place is None]
    if absent:
        fetch = f"radiogs-bench datasets fetch {suite.data_set} --data ROOT"
        raise DataError(
            f"suite '{suite.name}' needs scenes that are not here: {shown(absent)}",
            f"They do not come with the package. {suite.download}",
            f"Fetch them:  {fetch}   and run with the same --data ROOT.  Or say where they are:  radiogs-bench run"
            f" {suite.name} --scenes PATH/{suite.scenes[0]},PATH/{suite.scenes[-1]}",
        )
    return tuple(place for place in places.values() if place is not None)


def absent_scenes(suite: Suite) -> list[str]:
    """The scenes of a suite that have to be downloaded first."""
    return [name for name in suite.scenes if _place(suite, name) is None] if suite.download else []


def _place(suite: Suite, name: str) -> str | None:
    """The folder of a scene: here, else the suite's data set in the root of data, else the only folder of this name
    there outside other data sets; None if missing."""
    in_set, root = f"{suite.data_set}/{name}", data_root()
    if Path(name).is_dir():
        return name
    if located(in_set) is not None:
        return in_set
    if root is None:
        return None
    others = DOWNLOADS.keys() - {suite.data_set}  # several data sets have a scene called hotdog
    found = [root / name, *(each for each in in_data_sets(root, name) if each.parent.name not in others)]
    there = [str(each) for each in found if each.is_dir()]
    return there[0] if len(there) == 1 else None


def load_scenes(wanted: Sequence[str], options: SceneOptions = AS_STORED) -> dict[str, Scene]:
    """Scenes by their names. Raises DataError for a missing one, UsageError for two of one name or the same files."""
    scenes: dict[str, Scene] = {}
    names: dict[str, str] = {}
    for each in wanted:
        scene = load_scene(each, options=options)
        if scene.name in scenes:
            raise UsageError(
                f"two scenes are called '{scene.name}'",
                "Their rows in a table could not be told apart.",
                "Rename one of the folders, or run them into folders of their own with --out.",
            )
        twin = names.setdefault(scene.checksum, scene.name)
        if twin != scene.name:
            raise UsageError(
                f"scenes '{twin}' and '{scene.name}' have the same files",
                "They would count as two in every mean and interval, which would look narrower than they are.",
                "Leave one of them out.",
            )
        scenes[scene.name] = scene
    return scenes


def place_of(name_or_path: str) -> str:
    """A scene's name or absolute path, which another working folder can use."""
    if name_or_path in known_names():
        return name_or_path
    return os.path.abspath(located(name_or_path) or name_or_path)
