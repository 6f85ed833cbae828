"""Scenes by name: the committed miniatures, or a folder on disk."""

from difflib import get_close_matches
from pathlib import Path

from radiogs.errors import DataError
from radiogs.scene import Scene

from .tensoir import load_tensoir

TINY = Path(__file__).parent / "tiny"


def scene_names() -> tuple[str, ...]:
    """Names of the miniatures that come with the package."""
    return tuple(sorted(path.name for path in TINY.iterdir() if (path / "transforms_train.json").is_file()))


def load_scene(name_or_path: str) -> Scene:
    """A miniature by its name, or the scene in a folder; for a folder that bears such a name write ``./name``.

    Raises DataError for what is neither, and for a scene that is incomplete or damaged.
    """
    if name_or_path in scene_names():
        return load_tensoir(TINY / name_or_path)
    folder = Path(name_or_path)
    if not folder.is_dir():
        near = get_close_matches(name_or_path, scene_names(), 1)
        raise DataError(
            f"there is no scene '{name_or_path}'",
            f"It is neither a folder nor one of the scenes that come with the package ({', '.join(scene_names())}).",
            f"Did you mean '{near[0]}'?" if near else "Give a scene's name, or the path of its folder.",
        )
    return load_tensoir(folder)
