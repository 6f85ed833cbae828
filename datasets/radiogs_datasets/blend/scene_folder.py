"""Writing the pictures of a .blend file as a scene in the TensoIR layout (``radiogs_datasets.layouts.tensoir``).

    <folder>.unfinished/.rendering/   request.json, lights as Blender reads them, what Blender printed, measures
    <folder>.passes/<view>.exr        every pass of the test views, where they are kept: no part of the scene

Views are rendered by several processes, each finished before its folder has its name: a command that was killed goes
on where it was.
"""

import json
import queue
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path

from radiogs_core.errors import UsageError

from ..image_files import read_hdr, write_exr, write_hdr
from ..layouts.tensoir_lights import TRAINING_LIGHT
from ..lights import read_light
from ..writing.new_folder import require_new
from ..writing.transforms import write_transforms
from . import metadata
from .cameras import SPLITS, Shot, shots
from .light_maps import refined
from .process import Blender, require_blender
from .request import Request
from .studio import Studio
from .view_folder import write_view

Progress = Callable[[int, int], None]


def write_scene(request: Request, folder: Path, workers: int, threads: int, progress: Progress) -> metadata.Metadata:
    """Render a request into ``folder``, absent or empty; returns what stands in its ``metadata.json``.

    ``workers`` processes with ``threads`` threads each. ``progress(done, total)`` is called after each view.
    Raises UsageError where Blender is not installed or the folder was begun for another request, DataError for a file
    that cannot be rendered.
    """
    unfinished = require_new(folder)
    state = unfinished / ".rendering"
    _begin(request, folder, state)
    require_blender()
    lights = _write_lights(request, unfinished / "envmaps", state)
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
        described = metadata.describe(request, opened, views, studios.get(), state)
    for split in SPLITS:
        of_split = [shot for shot in views if shot.split == split]
        write_transforms(
            unfinished / f"transforms_{split}.json",
            [shot.view() for shot in of_split],
            [f"./{shot.name}/rgba" for shot in of_split],
        )
    (unfinished / "metadata.json").write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    shutil.rmtree(state)
    unfinished.replace(folder)
    return described


def _begin(request: Request, folder: Path, state: Path) -> None:
    """Make the place, or find it as it was left; UsageError where views of another request are finished in it."""
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


def _write_lights(request: Request, folder: Path, state: Path) -> dict[str, Path]:
    """Write the scene's lights; returns each as Blender reads it. What is rendered is what is stored, 8-bit RGBE."""
    folder.mkdir(exist_ok=True)
    lights = {}
    for place, (name, path) in enumerate(request.light_files.items()):
        role = name if place else TRAINING_LIGHT
        write_hdr(folder / f"{role}.hdr", read_light(path)[0].radiance.numpy())
        lights[role] = state.absolute() / f"light_{place}.exr"
        write_exr(lights[role], refined(read_hdr(folder / f"{role}.hdr")))
    return lights
