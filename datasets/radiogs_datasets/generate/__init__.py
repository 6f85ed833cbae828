"""Path-traced scenes with complete ground truth, made with Mitsuba 3 (extra ``generate``)."""

from collections.abc import Callable
from pathlib import Path

from .catalogue import RECIPES, recipe
from .probe import require_mitsuba
from .recipe import Pictures

__all__ = ["RECIPES", "Pictures", "generate_scene"]

MINIATURE = Pictures()


def generate_scene(
    name: str,
    folder: Path,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
    pictures: Pictures = MINIATURE,
) -> None:
    """Render the scene ``name`` into ``folder``: images, ground truth, lights, metadata.json.

    ``folder`` must be absent or empty; it appears when the scene is complete. ``progress(view, done, total)`` is
    called after each view. Deterministic for a seed on one machine. Raises UsageError for an unknown name, a folder
    that holds something, or where Mitsuba cannot run.
    """
    wanted = recipe(name)
    require_mitsuba()
    # Mitsuba is an extra, and with a wrong LLVM it ends the process: it is imported when the probe has passed.
    from ..writing import made_beside
    from .scene_folder import write_scene

    # It is made beside its folder and renamed at the end: no run leaves half a scene.
    with made_beside(folder) as made:
        write_scene(wanted, made, seed, pictures, progress)
