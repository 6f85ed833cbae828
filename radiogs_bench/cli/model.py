"""``radiogs-bench train``, ``render`` and ``relight``: one model, outside any suite."""

import argparse
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .device import chosen_device
from .lights import add_light_options, marks, placed
from .options import (
    METHOD,
    PRESETS_HELP,
    add_data,
    add_device,
    add_effects,
    add_recipe,
    add_scene_options,
    add_set,
    add_verbose,
    declare,
    positive,
    scene_options,
    settings_from,
)

if TYPE_CHECKING:
    from torch import Tensor

    from radiogs_core.contract import Prepared, Run, Trained

    from ..api import Model
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
    """Declare the commands."""
    _add_train(commands)
    _add_render_and_relight(commands)


def _add_train(commands: "Commands") -> None:
    training = declare(
        commands, "train", "Train a model on one scene, or continue, and score it.",
        "train corner --out out/corner --preset smoke",
    )  # fmt: skip
    training.set_defaults(command=train)
    training.add_argument("scene", metavar="SCENE", help="Train on this scene, by name or folder.")
    training.add_argument(
        "--out", type=Path, metavar="DIR",
        help="Make this folder, or continue the training in it (default: out/ and the scene's name).",
    )  # fmt: skip
    training.add_argument("--preset", default="tiny", help=PRESETS_HELP.format("tiny"))
    training.add_argument("--seed", type=int, default=0, help="Seed all random numbers with this (default: 0).")
    training.add_argument(
        "--method",
        default=METHOD,
        help=f"Train this method (see `methods`), or the one in a TOML file (default: {METHOD}).",
    )
    add_recipe(training)
    training.add_argument(
        "--force", action="store_true", help="Move the files of another model in the folder aside, and train."
    )
    training.add_argument(
        "--no-score", dest="score", action="store_false", help="Leave out the scores of the test views at the end."
    )
    add_effects(training)
    add_set(training)
    add_scene_options(training)
    add_device(training)
    add_verbose(training)


def _add_render_and_relight(commands: "Commands") -> None:
    rendering = declare(commands, "render", "Render the views of a trained model.", "render out/corner --views test")
    rendering.set_defaults(command=render)
    rendering.add_argument(
        "--relight", action="store_true",
        help="Render the test views under the scene's other lights, too, as `score` compares them; their albedo is"
        " scaled as by protocol default.",
    )  # fmt: skip
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
    for command in (rendering, relighting):
        command.add_argument("folder", type=Path, metavar="DIR", help="Open the model that `train` left in DIR.")
        command.add_argument(
            "--views", choices=["test", "train"], default="test", help="Render the views of this split (default: test)."
        )
        add_data(command)
        add_device(command)
        add_verbose(command)


def factors(text: str) -> tuple[float, float, float]:
    """Three positive numbers separated by commas."""
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not three numbers such as 0.9,1,1.1") from None
    if not all(0 < factor < math.inf for factor in (red, green, blue)):
        raise argparse.ArgumentTypeError(f"'{text}': a factor of an albedo is finite and above zero")
    return red, green, blue


def train(options: argparse.Namespace) -> int:
    """Train, or continue, and write the model."""
    from .. import api
    from .reporter import say

    chosen_device(options)  # also sets the number of threads
    variant, budget = fields_from(options)
    folder = options.out or Path("out") / Path(options.scene).name
    model = api.train(
        options.method, options.scene, options.preset, variant, options.seed, options.device, folder,
        budget=budget, recipe=options.recipe or "", scene_options=scene_options(options), replace=options.force,
        say=say,
    )  # fmt: skip
    written = [path.name for path in model.files]
    size = f"{model.facts['surfels']} surfels in " if "surfels" in model.facts else ""
    say(f"{model.run.scene.name}: {size}{model.seconds:.0f} s")
    for remark in model.facts.get("remarks", ()):
        say(remark)
    if options.score:
        _score(model, folder, folder / "score.json")
        written.append("score.json")
    say(f"{folder}: {', '.join(written)}")
    say(f"Look at it:  radiogs-bench {'view' if size else 'render'} {folder}")
    return 0


def _score(model: "Model", folder: Path, path: Path) -> None:
    """Print the new model's metrics, and write their record."""
    from ..runs.progress import progress_for_stderr
    from ..runs.scene_digest import checksum_now
    from ..runs.scene_files import require_unchanged
    from ..scoring.metrics.protocols import protocol
    from ..scoring.record import record_of_model
    from .score import say_without_weights, show_record, write_record

    rules, run = [protocol("default")], model.run
    say_without_weights(rules)
    with progress_for_stderr() as progress:
        record = record_of_model(
            str(folder), model.method, model.trained, run.scene, run.device, rules,
            lambda done, total: progress.advance("scoring", done, total),
        )  # fmt: skip
    require_unchanged(run.scene, checksum_now)
    write_record(record, path)
    show_record(record)


def fields_from(options: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """The fields of the variant and of the budget that the options of ``train`` set. Raises UsageError."""
    from radiogs_core.plain_values import leaf_names

    from ..methods import method, settings_for

    used = method(options.method)
    variant: dict[str, Any] = {}
    if options.effects != "all":
        if "effects" not in leaf_names(used.variant()):
            raise no_effects(used.name)
        variant["effects"] = options.effects
    settings = settings_for(used, options.preset, settings_from(options))
    return {**variant, **settings.variant}, dict(settings.budget)


def no_effects(method: str) -> UsageError:
    """The error for a choice of effects of a method that has none."""
    return UsageError(f"{method} has no choice of effects", "", "Leave --effects out.")


def render(options: argparse.Namespace) -> int:
    """Write the recovered light and the maps of every view: images as PNG, the others as EXR."""
    from radiogs_datasets.image_files import write_exr

    from ..runs.trained_folder import read_about, read_trained
    from ..store.folder import Store

    with Store(options.folder).keeping_tracebacks():
        run, model = read_trained(options.folder, chosen_device(options))
        name = read_about(options.folder)["method"]
        folder, light = options.folder / "render", model.light
        if light is not None:
            folder.mkdir(parents=True, exist_ok=True)
            write_exr(folder / "environment.exr", light.radiance.cpu().numpy())
        write_views(name, prepared(name, model), run, options.views, folder)
        if options.relight:
            _write_relit(name, model, run, folder)
        return 0


def _write_relit(method: str, model: "Trained", run: "Run", folder: Path) -> None:
    """Write ``relit/LIGHT/VIEW.png`` of each relit test view that the scene has."""
    from radiogs_datasets.image_files import write_png

    from ..export.published_layout import albedo_scale, relit_views
    from ..runs.progress import progress_for_stderr
    from ..scoring.metrics.protocols import protocol
    from ..scoring.score_maps import lit_views
    from .reporter import say

    expected = 0 if run.scene.surrounded else sum(map(len, lit_views(run.scene, run.scene.test).values()))
    written = []
    with progress_for_stderr() as progress:
        scale = albedo_scale(
            model, run, method, protocol("default"), lambda done, total: progress.advance("scoring", done, total)
        )
        for light, view, maps in relit_views(model, run, method, scale):
            path = folder / "relit" / light / f"{view.name.replace('/', '_')}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_png(path, maps["image"].numpy())
            written.append(light)
            progress.advance("relighting", len(written), expected)
    if written:
        say(f"{len(written)} relit views in {folder / 'relit'}, under {', '.join(dict.fromkeys(written))}")
    elif expected:
        say(f"no relit views: {method} does not relight")
    else:
        say(f"no relit views: scene '{run.scene.name}' has no true image under another distant light")


def prepared(method: str, model: "Trained", *lit: Any) -> "Prepared":
    """The model, ready to be rendered under its own light, or under another light with a factor of the albedo."""
    from radiogs_core.contract import Prepared

    from ..method_calls import calling, require

    with calling(method, "prepare()"):
        ready = model.prepare(*lit)
    require(method, ready, Prepared, "prepare()")
    return ready


def relight(options: argparse.Namespace) -> int:
    """Write every view under another light."""
    import torch

    from radiogs_core.capabilities import Remarking
    from radiogs_datasets.lights import read_light

    from ..runs.progress import working
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.near_light import NOT_DISTANT
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
            about["method"], relit, run, options.views, options.folder / "relight" / mode,
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

    from ..export.trained_surfels import initial_viewpoint_in, surfels_in
    from ..export.turntable import cameras_around, from_outside
    from ..runs.progress import progress_for_stderr
    from ..scoring.maps import on_black

    surfels = surfels_in(model_folder, None)
    size = max(max(view.camera.width, view.camera.height) for view in (*run.scene.test, *run.scene.train))
    seen_from = initial_viewpoint_in(model_folder, None) or from_outside(surfels)
    pictures: list[Image.Image] = []
    with progress_for_stderr() as progress:
        for camera in cameras_around(surfels, frames, size, seen_from):
            progress.advance("turntable", len(pictures), frames)
            maps = on_black(relit, camera.to(run.device, torch.float32), method=method, view="of the turntable")
            pictures.append(Image.fromarray((maps["image"] * 255).round().byte().cpu().numpy()))
    path = folder / "relit.gif"
    folder.mkdir(parents=True, exist_ok=True)
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=max(3600 // frames, 20), loop=0)
    return path


class LevelShares:
    """How many pixels of relit frames are white, and how many black, where the model covers them."""

    def __init__(self) -> None:
        self.covered = self.white = self.black = 0

    def count(self, maps: Mapping[str, "Tensor"]) -> None:
        """Count the pixels of a frame by its maps on black (``scoring.maps.on_black``)."""
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


def write_views(
    method: str,
    shown: "Prepared",
    run: "Run",
    split: str,
    folder: Path,
    place_of: Callable[[str], str] = str,
    seen: Callable[[Mapping[str, "Tensor"]], None] = lambda maps: None,
) -> int:
    """Render each view of a split into ``folder``, in the layout ``plain`` of docs/scoring.md; says what a frame took.

    ``place_of``: the folder of each map by the map's name. ``seen`` receives the maps of each view, on black.
    """
    import statistics

    import torch

    from radiogs_datasets.image_files import write_exr, write_png

    from ..method_calls import calling
    from ..runs.progress import progress_for_stderr
    from ..scoring.frame_cost import frame_milliseconds
    from ..scoring.maps import on_black
    from .reporter import say

    views = run.scene.test if split == "test" else run.scene.train
    cameras = [view.camera.to(run.device, torch.float32) for view in views]
    with progress_for_stderr() as progress:
        for done, (view, camera) in enumerate(zip(views, cameras, strict=True)):
            progress.advance("rendering", done, len(views))
            maps = on_black(shown, camera, method=method, view=view.name)
            seen(maps)
            for kind, image in maps.items():
                path = folder / place_of(kind) / view.name.replace("/", "_")
                path.parent.mkdir(parents=True, exist_ok=True)
                if kind == "image":
                    write_png(path.with_name(f"{path.name}.png"), image.numpy())
                else:
                    write_exr(path.with_name(f"{path.name}.exr"), image.numpy())
    line = f"{len(views)} views in {folder}"
    if shown.timed:
        with calling(method, "render(), once more to be timed"):
            times = frame_milliseconds(shown.render, cameras, run.device)
        line += f"; {statistics.median(times):.2f} ms a frame"
    say(line)
    return 0
