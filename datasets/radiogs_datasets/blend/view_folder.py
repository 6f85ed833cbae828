"""The files of one view."""

import json
import shutil
from pathlib import Path

import numpy as np

from ..image_files import write_exr, write_png
from ..layouts.tensoir_lights import TRAINING_LIGHT
from ..writing.display import write_display
from .cameras import Shot
from .passes import Maps
from .studio import Studio


def write_view(studio: Studio, shot: Shot, folder: Path, state: Path) -> None:
    """Render one view into ``folder / shot.name``, which appears when it is complete; measures of it go to ``state``.

    A training view has its image alone; a test view every map, and one image for each other light.
    """
    place = state / f"{shot.name}.view"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    test = shot.split == "test"
    maps = studio.take(shot, keep=studio.passes / f"{shot.name}.exr" if test and studio.passes else None)
    write_display(place / "rgba.png", maps.image, maps.alpha, maps.alpha)
    if test:
        _write_maps(maps, place)
        for light in studio.lights.keys() - {TRAINING_LIGHT}:
            relit = studio.take(shot, light)
            write_display(place / f"rgba_{light}.png", relit.image, relit.alpha, maps.alpha)
            write_exr(place / f"indirect_{light}.exr", relit.indirect)
    (state / f"{shot.name}.json").write_text(json.dumps(measures(maps)), encoding="utf-8")
    place.replace(folder / shot.name)


def _write_maps(maps: Maps, place: Path) -> None:
    write_png(place / "albedo.png", np.concatenate([maps.albedo, maps.alpha], -1))
    write_png(place / "normal.png", np.concatenate([maps.normal * 0.5 + 0.5, maps.alpha], -1))
    if maps.roughness is not None:
        write_png(place / "roughness.png", maps.roughness)
    for name in ("depth", "direct", "indirect", "incident_indirect"):
        write_exr(place / f"{name}.exr", getattr(maps, name))


def measures(maps: Maps) -> dict[str, float | dict[str, float]]:
    """Sums over a view: of radiance, of its indirect part, and of what each feature's surfaces send."""
    sent = maps.image.sum(-1, keepdims=True, dtype=np.float64)
    return {
        "covered": float((maps.alpha > 0).mean()),
        "radiance": float(sent.sum()),
        "indirect": float(maps.indirect.sum(dtype=np.float64)),
        "closure": maps.closure,
        "features": {name: float((sent * weight).sum()) for name, weight in maps.features.items()},
    }
