"""``radiogs-bench relight``: the views of a trained model under another light, and a turntable under it."""

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .device import chosen_device
from .lights import add_light_options, marks, placed
from .model import add_views, no_effects, prepared, write_views
from .options import add_effects, declare, positive

if TYPE_CHECKING:
    from torch import Tensor

    from radiogs_core.contract import Prepared, Run

    from .options import Commands

ONLY_MODE = "default"
"""Folder of renders by a method that offers no choice of relighting."""


FRAMES = 36
"""Pictures of a relit turntable."""

COVERED = 0.5
"""Coverage from which a pixel counts as the model's."""

HALF_A_LEVEL = 0.5 / 255

MANY_WHITE, MANY_BLACK = 0.2, 0.5
"""Shares of white and of black pixels in relit frames above which they are named."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    relighting = declare(
        commands, "relight", "Render the views of a trained model under another light.",
        "relight out/corner --envmap sunset.hdr",
    )  # fmt: skip
    relighting.set_defaults(command=relight)
    relighting.add_argument(
        "--envmap", required=True, type=Path, metavar="FILE",
        help="Relight by this .hdr or .exr file: latitude-longitude, or a cube map that says how its faces lie.",
    )  # fmt: skip
    add_light_options(relighting)
    relighting.add_argument(
        "--mode",
        metavar="NAME",
        help="Choose one of the ways in which the method relights (default: that of the model's settings).",
    )
    relighting.add_argument(
        "--albedo-scale", type=factors, default=(1.0, 1.0, 1.0), metavar="R,G,B",
        help="Multiply the recovered albedo by these factors (default: 1,1,1).",
    )  # fmt: skip
    relighting.add_argument(
        "--turntable", type=positive, nargs="?", const=FRAMES, metavar="N",
        help="Also write a turntable under the light, relit.gif, as `view` writes one, of N pictures"
        f" (default: {FRAMES}).",
    )  # fmt: skip
    add_effects(relighting)
    add_views(relighting)


def factors(text: str) -> tuple[float, float, float]:
    """Three positive numbers separated by commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers such as 0.9,1,1.1") from None
    if not all(0 < factor < math.inf for factor in (red, green, blue)):
        raise argparse.ArgumentTypeError(f"'{text}': a factor of an albedo is finite and above zero")
    return red, green, blue


def relight(options: argparse.Namespace) -> int:
    """Write every view under another light."""
    import torch

    from radiogs_core.capabilities import Remarking
    from radiogs_core.own_files import own_folder
    from radiogs_datasets.lights import read_light

    from ..runs.progress import working
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.recovered_light import NOT_DISTANT
    from ..store.folder import Store
    from .reporter import say

    device = chosen_device(options)
    lit = lit_folder(options.envmap) + marks(options)
    light, repairs = read_light(options.envmap)
    for repair in repairs:
        say(repair)
    about = read_about(options.folder)
    mode, changes = chosen_mode(about["method"], options.mode, about["variant"])
    if "effects" in about["variant"]:
        changes["effects"] = options.effects
    elif options.effects != "all":
        raise no_effects(about["method"])
    with Store(options.folder).keeping_tracebacks():
        run, model = read_trained(options.folder, device, changes)
        if run.scene.surrounded:
            say(f"relighting means little here: {NOT_DISTANT}")
        light, stands = placed(options, run.scene, light)
        say(f"{options.envmap.name}: {stands}")
        with working(f"preparing {options.envmap.name}"):
            relit = prepared(about["method"], model, light, torch.tensor(options.albedo_scale))
        for remark in relit.remarks if isinstance(relit, Remarking) else ():
            say(remark)
        shares = LevelShares()
        write_views(
            about["method"], relit, run, options.views, own_folder(options.folder / "relight" / mode, options.folder),
            lambda kind: f"{'relit' if kind == 'image' else kind}/{lit}", shares.count,
        )  # fmt: skip
        for sentence in shares.sentences():
            say(sentence)
        if options.turntable is not None:
            folder = options.folder / "relight" / mode / "relit" / lit
            say(f"turntable: {write_turntable(about['method'], relit, run, options.folder, folder, options.turntable)}")
        return 0


def write_turntable(method: str, relit: "Prepared", run: "Run", model_folder: Path, folder: Path, frames: int) -> Path:
    """Write ``relit.gif`` into ``folder``: a relit model as ``view`` turns it, on black; returns its path.

    Pictures have the longer side of a test view. Raises DataError for a model without surfels.
    """
    import torch
    from PIL import Image

    from radiogs_core.own_files import fresh

    from ..export.trained_surfels import initial_viewpoint_in, surfels_in
    from ..export.turntable import cameras_around, from_outside
    from ..runs.progress import progress_for_stderr
    from ..scoring.rendering import on_black

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


class LevelShares:
    """How many pixels of relit frames are white, and how many black, where the model covers them."""

    def __init__(self) -> None:
        self.covered = self.white = self.black = 0

    def count(self, maps: Mapping[str, "Tensor"]) -> None:
        """Count the pixels of a frame by its maps on black (``scoring.rendering.on_black``)."""
        image = maps["image"]
        inside = maps["alpha"][..., 0] > COVERED if "alpha" in maps else image.amax(-1) >= 0
        levels = image[inside]
        self.covered += len(levels)
        self.white += int((levels.amin(-1) >= 1 - HALF_A_LEVEL).sum())
        self.black += int((levels.amax(-1) < HALF_A_LEVEL).sum())

    def sentences(self) -> list[str]:
        """A sentence where many pixels are white or black, with the option that changes it."""
        found = []
        for name, count, most, remedy in (
            ("white", self.white, MANY_WHITE, "a weaker light: --strength with a factor below 1"),
            ("black", self.black, MANY_BLACK, "a stronger light: --strength with a factor above 1"),
        ):
            if count > most * self.covered:
                share = f"{100 * count / self.covered:.0f} % of the model's pixels in these views"
                found.append(f"{share} are {name}: they are beyond what an image of 8 bits shows; {remedy}")
        return found


def chosen_mode(name: str, mode: str | None, variant: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The relighting mode of a method that was chosen, and the field of the variant that holds it.

    If none was chosen, it is that of the model's ``variant``, as plain values, else the method's default. Raises
    UsageError for a mode that the method does not offer.
    """
    from radiogs_core.capabilities import RelitInModes
    from radiogs_core.errors import unknown
    from radiogs_core.plain_values import flat

    from ..methods import method

    used = method(name)
    if not isinstance(used, RelitInModes):
        if mode is not None:
            raise UsageError(f"{used.name} relights in one way alone", "", "Leave --mode out.")
        return ONLY_MODE, {}
    modes = used.relighting_modes
    if mode is not None and mode not in modes.titles:
        raise unknown("relighting mode", mode, modes.titles, of=used.name)
    chosen = flat(variant).get(modes.field, modes.default) if mode is None else mode
    return chosen, {modes.field: chosen}


def lit_folder(envmap: Path) -> str:
    """Name of the folder for renders under a map: the map's, with its ending where an x.exr lies beside an x.hdr."""
    from radiogs_datasets.bounded_reading import require_storable

    if envmap.stem.strip(".") == "":
        raise UsageError(f"{envmap} has no name to store renders under", "", "Rename the file.")
    require_storable(envmap.name, "the light")
    two = envmap.suffix.lower() == ".exr" and envmap.with_suffix(".hdr").exists()
    return f"{envmap.stem}_exr" if two else envmap.stem
