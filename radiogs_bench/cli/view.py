"""``radiogs-bench view``: the surfels of a trained model in three dimensions."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from radiogs_core.errors import DataError, UsageError

from .options import Count
from .reporter import say
from .values import from_text, pixels


@dataclass(frozen=True)
class Drawing:
    """Options of a drawing."""

    colour: Literal["radiance", "albedo", "normal", "roughness"] = "radiance"
    """Colour surfels by this."""
    row: str | None = None
    """Show the model of this row of a run (default: the first)."""
    frames: Count = 36
    """Draw N pictures of the turntable."""
    size: Annotated[int, from_text(pixels)] = 640
    """Make pictures of so many pixels on each side."""
    window: bool = False
    """Also open a window, with surfels as opaque discs."""


def view(folder: Path, /, *, drawing: Annotated[Drawing, Parameter(name="*")] = Drawing()) -> None:
    """Draw a trained model's surfels as a page that turns them, a picture and a turntable.

    Example:  radiogs-bench view out/corner --colour albedo

    :param folder: Open the model that `train` or `run` left in this folder.
    """
    from PIL.Image import fromarray

    from radiogs_core.own_files import fresh, own_folder
    from radiogs_datasets.lights import read_light
    from radiogs_reports.page.surfels import write_viewer

    from ..export.trained_surfels import initial_viewpoint_in, surfels_in
    from ..export.turntable import cameras_around, from_outside, pictures
    from ..runs.progress import progress_for_stderr
    from ..scoring.metrics.surface_distance import pyvista
    from ..scoring.report_arrays import RECOVERED, arrays_of

    if drawing.window:
        require_screen()
        pyvista()
    surfels = surfels_in(folder, drawing.row)
    if not len(surfels):
        raise DataError(f"the model in '{folder}' has no surfels left", "There is nothing to draw.")
    place = own_folder(folder / "figures", folder)
    seen_from = initial_viewpoint_in(folder, drawing.row) or from_outside(surfels)
    cameras = cameras_around(surfels, drawing.frames, drawing.size, seen_from)
    title = folder.resolve().name + (f", {drawing.row}" if drawing.row else "")
    own = folder / "environment.exr"  # the light that a model of `train` has recovered
    arrays = arrays_of(surfels, seen_from, {RECOVERED: read_light(own)[0]} if own.exists() else {})
    page = write_viewer(arrays, title, place / "surfels.html")
    drawn = []
    with progress_for_stderr() as bar:
        for done, picture in enumerate(pictures(surfels, cameras, drawing.colour), 1):
            drawn.append(fromarray((picture * 255).round().byte().numpy()))
            bar.advance("turntable", done, len(cameras))
    drawn[0].save(fresh(place / "surfels.png", place))
    film = fresh(place / "surfels.gif", place)
    drawn[0].save(film, save_all=True, append_images=drawn[1:], duration=3600 // len(drawn), loop=0)
    say(f"{place}: surfels.png, surfels.gif; open {page}")
    if drawing.window:
        from radiogs_reports.figures.surfel_view import show

        show(arrays, drawing.colour)


def require_screen() -> None:
    """Raise UsageError without a screen on which a window can open."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError(
            "there is no screen to open a window on",
            "Neither DISPLAY nor WAYLAND_DISPLAY is set.",
            "Leave --window out, and open figures/surfels.html in a browser.",
        )
