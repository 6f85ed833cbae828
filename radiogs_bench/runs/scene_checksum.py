"""Reopens a scene, to digest its files as they are now.

A bench gets this function as a value, so that ``stages`` does not import it: every loader is imported here, and a
change in one must not change keys of cells whose scenes another loader reads (see ``sources``).
"""

from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.options import options_of


def checksum_now(scene: Scene) -> str:
    """The checksum of a scene's files now, or of a computed scene. Raises DataError if it is not a scene any more."""
    if scene.folder is None:
        return scene.checksum
    folder = str(scene.folder.resolve())  # absolute: a relative one may be the name of a miniature
    return load_scene(folder, layout=scene.layout, options=options_of(scene.options)).checksum
