"""Writing the pictures of a .blend file as a scene in the TensoIR layout (``radiogs_datasets.layouts.tensoir``).

    <folder>.unfinished/.rendering/   request.json, lights as Blender reads them, what Blender printed, measures
    <folder>.passes/<view>.exr        every pass of the test views, where they are kept: no part of the scene

Views are rendered by several processes, each finished before its folder has its name: a command that was killed goes
on where it was. ``metadata.json`` keeps how the scene was made, its noise, and what the BRDF cannot say of it.
"""

import json
import queue
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import torch

from radiogs_core.errors import UsageError
from radiogs_core.own_files import require_own_folders
from radiogs_core.scene.colour import srgb_encode
from radiogs_core.scene.scene import View

from ..image_files import read_hdr, write_exr, write_hdr, write_png
from ..layouts.tensoir import TRAINING_LIGHT
from ..lights import read_light
from ..writing import psnr, require_new, write_display, write_transforms
from .cameras import SPLITS, Shot, shots
from .passes import Maps
from .process import Blender, require_blender
from .request import Request
from .studio import Studio, refined

Metadata = dict[str, Any]

Progress = Callable[[int, int], None]


def write_scene(request: Request, folder: Path, workers: int, threads: int, progress: Progress) -> Metadata:
    """Render a request into ``folder``, absent or empty; returns the content of its ``metadata.json``.

    ``workers`` processes with ``threads`` threads each. ``progress(done, total)`` is called after each view.
    Raises UsageError where Blender is not installed or the folder was begun for another request, DataError for a file
    that cannot be rendered.
    """
    require_new(folder)
    unfinished = folder.with_name(f"{folder.name}.unfinished")
    state = unfinished / ".rendering"
    _begin(request, folder, state)
    require_blender()
    lights = write_lights(request, unfinished / "envmaps", state)
    passes = folder.with_name(f"{folder.name}.passes") if request.keep_passes else None
    if passes is not None:
        passes.mkdir(exist_ok=True)
    with ThreadPoolExecutor(workers) as pool, ExitStack() as open_processes:
        studios: queue.SimpleQueue[Studio] = queue.SimpleQueue()
        opened = {}
        for number in range(workers):
            blender = open_processes.enter_context(Blender(state / f"blender_{number}.log"))
            opened = blender.ask("open", file=str(request.file.absolute()), device=request.device, threads=threads)
            studios.put(Studio(blender, request, lights, state / f"picture_{number}.exr", passes))
        views = shots(request, opened["low"], opened["high"])

        def make(shot: Shot) -> None:
            studio = studios.get()
            try:
                write_view(studio, shot, unfinished, state)
            finally:
                studios.put(studio)

        pending = [shot for shot in views if not (unfinished / shot.name).is_dir()]
        tasks = [pool.submit(make, shot) for shot in pending]
        try:
            for done, task in enumerate(as_completed(tasks), len(views) - len(pending) + 1):
                task.result()
                progress(done, len(views))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        described = describe(request, opened, views, studios.get(), state)
    for split in SPLITS:
        of_split = [shot for shot in views if shot.split == split]
        write_transforms(
            unfinished / f"transforms_{split}.json",
            [View(shot.name, shot.camera, {}) for shot in of_split],
            [f"./{shot.name}/rgba" for shot in of_split],
        )
    (unfinished / "metadata.json").write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    shutil.rmtree(state)
    unfinished.replace(folder)
    return described


def _begin(request: Request, folder: Path, state: Path) -> None:
    """Make the unfinished folder, or continue it. Raises UsageError for another folder, or views of another request."""
    require_own_folders(folder.parent, state.parent.name, f"{state.parent.name}/{state.name}")
    if not state.is_dir():
        require_new(state.parent)
    wanted = json.dumps(request.identity(), indent=1, sort_keys=True)
    begun = state / "request.json"
    other = begun.is_file() and begun.read_text(encoding="utf-8") != wanted
    if other and any(state.parent.glob("*/rgba.png")):
        raise UsageError(
            f"{state.parent} was begun with other options, or for another file",
            "Its views are of one request; these would be of another.",
            f"Give the options it was begun with, remove it, or choose another folder than {folder}.",
        )
    try:
        if other:
            shutil.rmtree(state.parent)
        state.mkdir(parents=True, exist_ok=True)
        begun.write_text(wanted, encoding="utf-8")
    except OSError as error:
        raise UsageError(
            f"cannot write into {state}", f"The system says: {error.strerror}.", "Choose another folder."
        ) from error


def write_lights(request: Request, folder: Path, state: Path) -> dict[str, Path]:
    """Write the scene's lights; returns the file of each for Blender, which renders the stored 8-bit RGBE values."""
    folder.mkdir(exist_ok=True)
    lights = {}
    for place, (name, path) in enumerate(request.light_files.items()):
        role = name if place else TRAINING_LIGHT
        write_hdr(folder / f"{role}.hdr", read_light(path)[0].radiance.numpy())
        lights[role] = state.absolute() / f"light_{place}.exr"
        write_exr(lights[role], refined(read_hdr(folder / f"{role}.hdr")))
    return lights


def write_view(studio: Studio, shot: Shot, folder: Path, state: Path) -> None:
    """Render one view into ``folder / shot.name``, which appears when complete; its measures are added to ``state``.

    A training view has its image alone; a test view every map, and one image for each other light.
    """
    place = state / f"{shot.name}.view"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    test = shot.split == "test"
    maps = studio.take(shot, keep=studio.passes / f"{shot.name}.exr" if test and studio.passes else None)
    write_display(place / "rgba.png", maps.image, maps.alpha, maps.alpha)
    if test:
        write_png(place / "albedo.png", np.concatenate([maps.albedo, maps.alpha], -1))
        write_png(place / "normal.png", np.concatenate([maps.normal * 0.5 + 0.5, maps.alpha], -1))
        if maps.roughness is not None:
            write_png(place / "roughness.png", maps.roughness)
        for name in ("depth", "direct", "indirect", "incident_indirect"):
            write_exr(place / f"{name}.exr", getattr(maps, name))
        for light in studio.lights.keys() - {TRAINING_LIGHT}:
            relit = studio.take(shot, light)
            write_display(place / f"rgba_{light}.png", relit.image, relit.alpha, maps.alpha)
            write_exr(place / f"indirect_{light}.exr", relit.indirect)
    (state / f"{shot.name}.json").write_text(json.dumps(measures(maps)), encoding="utf-8")
    place.replace(folder / shot.name)


def measures(maps: Maps) -> dict[str, float | dict[str, float]]:
    """Sums over a view: its radiance, the indirect part, and the radiance of surfaces with each feature."""
    sent = maps.image.sum(-1, keepdims=True, dtype=np.float64)
    return {
        "covered": float((maps.alpha > 0).mean()),
        "radiance": float(sent.sum()),
        "indirect": float(maps.indirect.sum(dtype=np.float64)),
        "closure": maps.closure,
        "features": {name: float((sent * weight).sum()) for name, weight in maps.features.items()},
    }


NOISY = ("image", "direct", "indirect", "incident_indirect", "albedo", "normal", "depth")
"""Maps whose noise floor the metadata state."""

SMALLEST_SHARE = 1e-4
"""Share of a view's energy below which a feature is not reported."""


def describe(
    request: Request, opened: Mapping[str, Any], views: Sequence[Shot], studio: Studio, state: Path
) -> Metadata:
    """The metadata of a scene whose views are done; noise and truncation are measured on its first test view."""
    measured = {shot.name: json.loads((state / f"{shot.name}.json").read_text(encoding="utf-8")) for shot in views}
    test = [measured[shot.name] for shot in views if shot.split == "test"]
    radiance = sum(each["radiance"] for each in test)
    scored = next(shot for shot in views if shot.split == "test")
    first, second = studio.take(scored), studio.take(scored, other_seed=True)
    shown = [srgb_encode(torch.from_numpy(each.image)).clamp(0, 1).numpy() for each in (first, second)]
    deeper = studio.take(scored, bounces=2 * request.bounces)
    return {
        "scene": request.file.stem,
        "purpose": "rendered from a .blend file by Blender Cycles",
        **request.identity(),
        "noise_floor_db": psnr(*shown),
        "noise_floors_db": {name: psnr(getattr(first, name), getattr(second, name)) for name in NOISY},
        "energy_beyond_bounces": _share(float((deeper.image - first.image).sum()), float(deeper.image.sum())),
        "indirect_share": _share(sum(each["indirect"] for each in test), radiance),
        "largest_closure_error": max(each["closure"] for each in measured.values()),
        "views_of_nothing": [name for name, each in measured.items() if not each["covered"]],
        "energy_of_what_the_brdf_cannot_say": {
            name: share
            for name in test[0]["features"]
            if (share := _share(sum(each["features"][name] for each in test), radiance)) >= SMALLEST_SHARE
        },
        "materials": opened["materials"],
        "materials_not_understood": opened["not_understood"],
        "opened": {name: opened[name] for name in OPENED},
        "training_light": next(iter(request.light_files)),
        "versions": {"blender": opened["blender"], "numpy": np.__version__, "torch": torch.__version__},
    }


OPENED = ("scene", "low", "high", "objects", "instances", "unit_scale", "unit_system", "scripts", "lamps", "cameras",
          "volumes", "other_scenes")  # fmt: skip


def _share(part: float, whole: float) -> float:
    return round(part / whole, 4) if whole else 0.0
