"""Opens a scene once more, for what its files digest to now.

A bench is handed this function, so that ``stages`` need not import it: every loader is imported here, and a change of
one must not change the keys of cells on scenes that another one reads (see ``sources``).
"""

from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.options import options_of


def checksum_now(scene: Scene) -> str:
    """The checksum of a scene's files now, or of a computed scene. Raises DataError for what is no scene any more."""
    if scene.folder is None:
        return scene.checksum
    folder = str(scene.folder.resolve())  # absolute: a relative one may be the name of a miniature
    return load_scene(folder, layout=scene.layout, options=options_of(scene.options)).checksum
