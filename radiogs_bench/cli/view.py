"""``radiogs-bench view``: the surfels of a trained model in three dimensions."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import DataError, UsageError

from .options import add_verbose, declare, pixels, positive

if TYPE_CHECKING:
    from PIL.Image import Image
    from torch import Tensor

    from radiogs_core.surfels.surfels import Surfels
    from radiogs_reports.figures.surfel_view import Disks

    from .options import Commands

COLOURS = ("radiance", "albedo", "normal", "roughness")


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "view", "Draw a trained model's surfels as a page that turns them, a picture and a turntable.",
        "view out/corner --colour albedo", help="Draw a trained model's surfels in three dimensions.",
    )  # fmt: skip
    parser.set_defaults(command=view)
    parser.add_argument("folder", type=Path, metavar="DIR", help="Open the model that `train` or `run` left in DIR.")
    parser.add_argument(
        "--colour", choices=COLOURS, default="radiance", help="Colour surfels by this (default: radiance)."
    )
    parser.add_argument("--row", metavar="ROW", help="Show the model of this row of a run (default: the first).")
    parser.add_argument(
        "--frames", type=positive, default=36, metavar="N", help="Draw N pictures of the turntable (default: 36)."
    )
    parser.add_argument(
        "--size",
        type=pixels,
        default=640,
        metavar="PIXELS",
        help="Make pictures this large on each side (default: 640).",
    )
    parser.add_argument("--window", action="store_true", help="Also open a window, with surfels as opaque discs.")
    add_verbose(parser)


def view(options: argparse.Namespace) -> int:
    """Write surfels.html (turns in a browser), surfels.png and surfels.gif into the folder's ``figures``.

    Raises UsageError where no window can be opened or ``figures`` is a link, DataError where there are no surfels.
    """
    from radiogs_core.own_files import fresh, own_folder
    from radiogs_reports.page.surfels import write_viewer

    from ..export.trained_surfels import initial_viewpoint_in, surfels_in
    from ..export.turntable import cameras_around, from_outside, pictures
    from ..runs.progress import progress_for_stderr
    from ..scoring.metrics.surface_distance import pyvista
    from ..scoring.report_arrays import arrays_of
    from .reporter import say

    if options.window:
        require_screen()
        pyvista()
    surfels = surfels_in(options.folder, options.row)
    if not len(surfels):
        raise DataError(f"the model in '{options.folder}' has no surfels left", "There is nothing to draw.")
    folder = own_folder(options.folder / "figures", options.folder)
    seen_from = initial_viewpoint_in(options.folder, options.row) or from_outside(surfels)
    cameras = cameras_around(surfels, options.frames, options.size, seen_from)
    title = options.folder.resolve().name + (f", {options.row}" if options.row else "")
    page = write_viewer(arrays_of(surfels, seen_from), title, folder / "surfels.html")
    with progress_for_stderr() as bar:
        frames = []
        for done, picture in enumerate(pictures(surfels, cameras, options.colour), 1):
            frames.append(as_image(picture))
            bar.advance("turntable", done, len(cameras))
    frames[0].save(fresh(folder / "surfels.png", folder))
    film = fresh(folder / "surfels.gif", folder)
    frames[0].save(film, save_all=True, append_images=frames[1:], duration=3600 // len(frames), loop=0)
    say(f"{folder}: surfels.png, surfels.gif; open {page}")
    if options.window:
        from radiogs_reports.figures.surfel_view import show

        show(disks_of(surfels, options.colour), lit=options.colour == "albedo")
    return 0


def require_screen() -> None:
    """Raise UsageError where there is no screen to open a window on."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UsageError(
            "there is no screen to open a window on",
            "Neither DISPLAY nor WAYLAND_DISPLAY is set.",
            "Leave --window out, and open figures/surfels.html in a browser.",
        )


def as_image(picture: "Tensor") -> "Image":
    """The picture ([height, width, 3], in [0, 1]) with 8 bits."""
    from PIL import Image as images

    return images.fromarray((picture * 255).round().byte().numpy())


def disks_of(surfels: "Surfels", colour: str) -> "Disks":
    """Surfels as plain arrays, coloured by their mean radiance (degree 0), albedo or normal."""
    import torch

    from radiogs_core.scene.colour import srgb_encode
    from radiogs_core.surfels.harmonics import surfel_radiance
    from radiogs_reports.figures.surfel_view import Disks

    with torch.no_grad():
        frame = surfels.frame
        up = torch.tensor([0.0, 0.0, 1.0]).expand_as(surfels.centre)
        shown = {
            "albedo": lambda: srgb_encode(surfels.albedo),
            "normal": lambda: frame[..., 2] * 0.5 + 0.5,
            "roughness": lambda: surfels.roughness[:, None].expand(-1, 3),
            "radiance": lambda: srgb_encode(surfel_radiance(surfels.sh[:, :1], up)),
        }[colour]()
        tangents = frame[..., :2].mT * surfels.scale[..., None]
        arrays = (surfels.centre, tangents, surfels.opacity, shown.clamp(0, 1))
        return Disks(*(each.double().numpy() for each in arrays))
