"""A scene in another layout."""

import shutil
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path

from radiogs_core.errors import UsageError
from radiogs_core.scene.scene import Scene

from .layouts import WRITERS
from .new_folder import require_new
from .transforms import write_transforms

LAYOUTS = tuple(WRITERS)

Advance = Callable[[int, int], None]


def convert(scene: Scene, folder: Path, layout: str, advance: Advance = lambda done, total: None) -> tuple[str, ...]:
    """Write the scene below ``folder``; returns a sentence for each thing that the layout cannot carry.

    Colours become 8-bit PNG, radiance half-float EXR, as the layout has them. ``advance`` is told (done, total) views.
    The folder is made beside its place and renamed at the end: an interrupted conversion leaves no half scene. Raises
    UsageError for an unknown layout or a folder that holds something, DataError for a damaged scene or for cameras that
    the layout cannot say.
    """
    if layout not in WRITERS:
        near = get_close_matches(layout, WRITERS, 1)
        hint = f"Did you mean '{near[0]}'?" if near else ""
        raise UsageError(f"no writer for layout '{layout}'", hint, f"Writers: {', '.join(WRITERS)}.")
    unfinished = require_new(folder)
    shutil.rmtree(unfinished, ignore_errors=True)
    try:
        unfinished.mkdir(parents=True)
        lost = _write(scene, unfinished, layout, advance)
        unfinished.replace(folder)
    except OSError as error:
        raise UsageError(f"cannot write {folder}", f"The system says: {error.strerror}.", "Free it.") from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    return lost


def _write(scene: Scene, folder: Path, layout: str, advance: Advance) -> tuple[str, ...]:
    writer = WRITERS[layout]
    lost: list[str] = []
    done, total = 0, len(scene.train) + len(scene.test)
    for split, views in (("train", scene.train), ("test", scene.test)):
        names = [writer.frame(split, number) for number in range(len(views))]
        write_transforms(folder / f"transforms_{split}.json", views, names, writer.lenses)
        left: dict[str, int] = {}
        for number, view in enumerate(views):
            written = writer.view(folder, view, split, number)
            for name in sorted(view.sources.keys() - set(written)):
                left[name] = left.get(name, 0) + 1
            done += 1
            advance(done, total)
        lost += [f"{name} of {count} {split} views has no place in layout '{layout}'" for name, count in left.items()]
    lights = dict(scene.lights)
    if scene.training_light is not None:
        lights[writer.training_light or "training"] = scene.training_light
    for name, light in lights.items():
        if writer.light is None:
            lost.append(f"light '{name}' has no place in layout '{layout}'")
        else:
            writer.light(folder, name, light)
    return tuple(lost)
