"""The views of a trained model as files, in layout ``plain`` of docs/protocols.md, and a turntable of a relit one."""

import statistics
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from radiogs_core.contract import Prepared, Run, Trained
from radiogs_core.errors import UsageError
from radiogs_core.own_files import fresh, own_folder
from radiogs_core.scene.lamps import Lamp
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.lamp_light import RelitByLamps
from radiogs_datasets.image_files import write_exr, write_png

from ..installed_methods import offered_methods
from ..method_calls import calling, require
from ..methods import method as installed_method
from ..runs.progress import progress_for_stderr
from ..scoring.metrics.protocols import protocol
from ..scoring.rendering import frame_milliseconds, on_black
from ..scoring.score_maps import lit_views
from .published_layout import albedo_scale, relit_views
from .trained_surfels import initial_viewpoint_in, surfels_in
from .turntable import cameras_around, from_outside

COVERED = 0.5
"""Coverage from which a pixel counts as covered by the model."""

HALF_A_LEVEL = 0.5 / 255

MANY_WHITE, MANY_BLACK = 0.2, 0.5
"""Shares of white and of black pixels in relit frames above which a warning names them."""


def write_views(
    method: str,
    shown: Prepared,
    run: Run,
    split: str,
    folder: Path,
    place_of: Callable[[str], str] = str,
    seen: Callable[[Mapping[str, Tensor]], None] = lambda maps: None,
) -> str:
    """Render each view of a split into ``folder``, images as PNG and maps as EXR; returns how many, the path of the
    first image, and a frame's time.

    ``place_of``: the folder of each map by the map's name. ``seen`` receives the maps of each view, on black.
    """
    views = run.scene.test if split == "test" else run.scene.train
    cameras = [view.camera.to(run.device, torch.float32) for view in views]
    with progress_for_stderr() as progress:
        for done, (view, camera) in enumerate(zip(views, cameras, strict=True)):
            progress.advance("rendering", done, len(views))
            maps = on_black(shown, camera, method=method, view=view.name)
            seen(maps)
            for kind, image in maps.items():
                path = folder / place_of(kind) / view.name.replace("/", "_")
                own_folder(path.parent, folder)
                if kind == "image":
                    write_png(path.with_name(f"{path.name}.png"), image.numpy())
                else:
                    write_exr(path.with_name(f"{path.name}.exr"), image.numpy())
    first = folder / place_of("image") / f"{views[0].name.replace('/', '_')}.png"
    written = f"{len(views)} views in {folder}, such as {first}"
    if not shown.timed:
        return written
    with calling(method, "render(), once more to be timed"):
        times = frame_milliseconds(shown.render, cameras, run.device)
    return f"{written}; {statistics.median(times):.2f} ms a frame"


def write_relit_views(method: str, model: Trained, run: Run, folder: Path) -> str:
    """Write ``relit/LIGHT/VIEW.png`` of each relit test view that the scene has; returns what was written, or why not.

    The albedo is scaled as by protocol default.
    """
    expected = 0 if run.scene.surrounded else sum(map(len, lit_views(run.scene, run.scene.test).values()))
    written = []
    with progress_for_stderr() as progress:
        scale = albedo_scale(model, run, method, protocol("default"), partial(progress.advance, "scoring"))
        for light, view, maps in relit_views(model, run, method, scale):
            path = fresh(folder / "relit" / light / f"{view.name.replace('/', '_')}.png", folder)
            write_png(path, maps["image"].numpy())
            written.append(light)
            progress.advance("relighting", len(written), expected)
    if written:
        return f"{len(written)} relit views in {folder / 'relit'}, under {', '.join(dict.fromkeys(written))}"
    if expected:
        return f"no relit views: {method} does not relight"
    return f"no relit views: scene '{run.scene.name}' has no true image under another distant light"


def lit_by_lamps(
    name: str,
    model: Trained,
    lamps: Sequence[Lamp],
    light: EnvironmentMap | None = None,
    albedo_scale: Float[Tensor, "3"] | None = None,
) -> Prepared:
    """The model of the method ``name``, lit by lamps and, if given, by a map; see ``RelitByLamps``.

    Raises UsageError for a method that takes no lamps, and for a lamp that is refused; DataError; MethodFailed.
    """
    used = installed_method(name)
    if not isinstance(used, RelitByLamps):
        able = [each for each in sorted(offered_methods()) if isinstance(installed_method(each), RelitByLamps)]
        raise UsageError(f"{name} takes no lamps", f"Methods that do: {', '.join(able)}.", "Relight it by a map.")
    with calling(name, "relit_by_lamps()"):
        ready = used.relit_by_lamps(model, lamps, light, torch.ones(3) if albedo_scale is None else albedo_scale)
    require(name, ready, Prepared, "relit_by_lamps()")
    return ready


def write_turntable(method: str, relit: Prepared, run: Run, model_folder: Path, folder: Path, frames: int) -> Path:
    """Write ``relit.gif`` into ``folder``: a relit model as ``view`` turns it, on black; returns its path.

    Pictures have the longer side of a test view. Raises DataError for a model without surfels.
    """
    surfels = surfels_in(model_folder, None)
    size = max(max(view.camera.width, view.camera.height) for view in (*run.scene.test, *run.scene.train))
    seen_from = initial_viewpoint_in(model_folder, None) or from_outside(surfels)
    pictures: list[Image.Image] = []
    with progress_for_stderr() as progress:
        for camera in cameras_around(surfels, frames, size, seen_from):
            progress.advance("turntable", len(pictures), frames)
            maps = on_black(relit, camera.to(run.device, torch.float32), method=method, view="of the turntable")
            pictures.append(Image.fromarray((maps["image"] * 255).round().byte().cpu().numpy()))
    path = fresh(folder / "relit.gif", model_folder)
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=max(3600 // frames, 20), loop=0)
    return path


def count_levels(counts: Counter[str], maps: Mapping[str, Tensor]) -> None:
    """Count a frame's white, black and covered pixels, from its maps on black (``scoring.rendering.on_black``); white
    and black ones count only inside the coverage.
    """
    image = maps["image"]
    levels = image[maps["alpha"][..., 0] > COVERED if "alpha" in maps else image.amax(-1) >= 0]
    counts["covered"] += len(levels)
    counts["white"] += int((levels.amin(-1) >= 1 - HALF_A_LEVEL).sum())
    counts["black"] += int((levels.amax(-1) < HALF_A_LEVEL).sum())


def beyond_levels(counts: Counter[str]) -> Iterator[str]:
    """Sentences where many of the counted pixels are white or black, with the option that changes it."""
    for name, most, remedy in (
        ("white", MANY_WHITE, "a weaker light: --strength with a factor below 1"),
        ("black", MANY_BLACK, "a stronger light: --strength with a factor above 1"),
    ):
        if counts[name] > most * counts["covered"]:
            share = f"{100 * counts[name] / counts['covered']:.0f} % of the model's pixels in these views"
            yield f"{share} are {name}: they are beyond what an image of 8 bits shows; {remedy}"
