"""``radiogs-bench train`` and ``render``: one model, outside any suite."""

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .device import chosen_device
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
    scene_options,
    settings_from,
)
from .trusting import add_trust

if TYPE_CHECKING:
    from torch import Tensor

    from radiogs_core.contract import Prepared, Run, Trained

    from ..api import Model
    from .options import Commands


def add_to(commands: "Commands") -> None:
    """Declare the commands."""
    _add_train(commands)
    _add_render(commands)


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


def _add_render(commands: "Commands") -> None:
    rendering = declare(commands, "render", "Render the views of a trained model.", "render out/corner --views test")
    rendering.set_defaults(command=render)
    rendering.add_argument(
        "--relight", action="store_true",
        help="Render the test views under the scene's other lights, too, as `score` compares them; their albedo is"
        " scaled as by protocol default.",
    )  # fmt: skip
    add_views(rendering)


def add_views(parser: argparse.ArgumentParser) -> None:
    """Add the model's folder and the split of views, for commands that render a trained model."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="Open the model that `train` left in DIR.")
    parser.add_argument(
        "--views", choices=["test", "train"], default="test", help="Render the views of this split (default: test)."
    )
    add_trust(parser)
    add_data(parser)
    add_device(parser)
    add_verbose(parser)


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
    from ..runs.scene_checksum import checksum_now
    from ..runs.unchanged_scene import require_unchanged
    from ..scoring.metrics.protocols import protocol
    from ..scoring.score_record import record_of_model
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
    from radiogs_core.own_files import own_folder
    from radiogs_datasets.image_files import write_exr

    from ..runs.trained_folder import read_about, read_trained
    from ..store.folder import Store

    with Store(options.folder).keeping_tracebacks():
        run, model = read_trained(options.folder, chosen_device(options))
        name = read_about(options.folder)["method"]
        folder, light = own_folder(options.folder / "render", options.folder), model.light
        if light is not None:
            write_exr(folder / "environment.exr", light.radiance.cpu().numpy())
        write_views(name, prepared(name, model), run, options.views, folder)
        if options.relight:
            _write_relit(name, model, run, folder)
        return 0


def _write_relit(method: str, model: "Trained", run: "Run", folder: Path) -> None:
    """Write ``relit/LIGHT/VIEW.png`` of each relit test view that the scene has."""
    from radiogs_core.own_files import fresh
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
            path = fresh(folder / "relit" / light / f"{view.name.replace('/', '_')}.png", folder)
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

    from radiogs_core.own_files import own_folder
    from radiogs_datasets.image_files import write_exr, write_png

    from ..method_calls import calling
    from ..runs.progress import progress_for_stderr
    from ..scoring.rendering import frame_milliseconds, on_black
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
                own_folder(path.parent, folder)
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
