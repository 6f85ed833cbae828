"""The scenes that a suite is run on."""

from collections.abc import Sequence
from pathlib import Path

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene, scene_names
from radiogs_datasets.layouts.inspection import shown
from radiogs_datasets.options import AS_STORED, SceneOptions
from radiogs_datasets.registry import located

from .suite import Suite


def own_scenes(suite: Suite) -> Sequence[str]:
    """The scenes of a suite: folders here, else in the root of data, in the folder of the suite's data set.

    Raises DataError if they are in neither and have to be downloaded.
    """
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
    """A folder here, else the scene of the suite's data set, else one of that name; None where there is none."""
    in_set = f"{suite.data_set}/{name}"
    tried = (name, in_set) if Path(name).is_dir() else (in_set, name)
    return next((each for each in tried if located(each) is not None), None)


def load_scenes(wanted: Sequence[str], options: SceneOptions = AS_STORED) -> dict[str, Scene]:
    """Scenes by their own names, opened as the options say.

    Raises DataError for a missing scene, UsageError if two have the same name, or the same files under two names.
    """
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
    """A scene's name or absolute path, valid in another working folder."""
    if name_or_path in scene_names():
        return name_or_path
    return str((located(name_or_path) or Path(name_or_path)).resolve())
