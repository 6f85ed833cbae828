"""``radiogs-bench train`` and ``render``: one model, outside any suite."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter
from rich.markup import escape

from radiogs_core.errors import UsageError
from radiogs_datasets.options import AS_STORED

from .options import (
    AS_TRAINED,
    METHOD,
    ON_CPU,
    UNCHANGED,
    Changes,
    Computing,
    Data,
    MethodName,
    Opened,
    Opening,
    PresetName,
    SceneName,
    no_effects,
)
from .reporter import say, show

if TYPE_CHECKING:
    from ..api import Model


SETTINGS = "settings.toml"
"""The file of a trained model with every field of its variant and budget."""

MAIN = ("nvs/psnr,ssim", "albedo/psnr", "normal/mae", "roughness/mse", "relight/psnr")
"""The metrics that are printed after a training."""


@dataclass(frozen=True)
class Training:
    """Options of a training."""

    out: Path | None = None
    """Make this folder, or continue the training in it (default: out/ and the scene's name)."""
    preset: PresetName = "tiny"
    """Take the amount of work of this preset."""
    seed: int = 0
    """Seed all random numbers with this."""
    method: MethodName = METHOD
    """Train this method (see `methods`), or the one in a TOML file."""
    force: bool = False
    """Move the files of another model in the folder aside, and train."""
    no_score: bool = False
    """Leave out the scores of the test views at the end."""
    config: Path | None = None
    """Take settings from this file, such as the OUT/settings.toml of another training; --set changes some of them."""
    start: Path | None = None
    """Start from the splats in this .ply file of 3DGS, 2DGS or gsplat, which is in the scene's world, and leave out the
    first half of stage 1 (--set geometry.start.splat_skips=1 leaves out all of it)."""


def train(
    scene: SceneName,
    /,
    *,
    asked: Annotated[Training, Parameter(name="*")] = Training(),
    changes: Changes = UNCHANGED,
    data: Data = None,
    opened: Opened = AS_STORED,
    on: Computing = ON_CPU,
) -> None:
    """Train a model on one scene, or continue, and score it.

    Example:  radiogs-bench train corner --out out/corner --preset smoke

    :param scene: Train on this scene, by name or folder.
    """
    from .. import api
    from ..methods import method, settings_as_toml
    from ..store.atomic import write_atomically

    on.use()
    variant, budget = fields_of(asked.method, asked.preset, changes, asked.config)
    folder = asked.out or Path("out") / Path(scene).absolute().name
    model = api.train(
        asked.method, scene, asked.preset, variant, asked.seed, on.device, folder,
        budget=budget, recipe=changes.recipe, scene_options=opened, replace=asked.force, say=say,
        start=asked.start,
    )  # fmt: skip
    written = [*(path.name for path in model.files), SETTINGS]
    text, unlike = settings_as_toml(method(asked.method), model.run)
    write_atomically(folder / SETTINGS, text.encode())
    size = f"{model.facts['surfels']} surfels in " if "surfels" in model.facts else ""
    say(f"{model.run.scene.name}: {size}{model.seconds:.0f} s")
    say(*model.facts.get("remarks", ()))
    if unlike:
        say(f"{unlike} settings are not as published: {folder / SETTINGS} says which")
    if not asked.no_score:
        written += ["score.json", _score(model, folder).name]
    say(f"{folder}: {', '.join(written)}")
    say(f"Look at it:  radiogs-bench {'view' if size else 'render'} {folder}")


def _score(model: "Model", folder: Path) -> Path:
    """Print the new model's main metrics, write the record of all and a sheet of its maps; returns the sheet's path."""
    from rich.table import Table

    from radiogs_reports.figures.contact_sheet import write_bands
    from radiogs_reports.wording import ARROWS

    from ..runs.progress import progress_for_stderr
    from ..runs.scene_checksum import checksum_now
    from ..runs.unchanged_scene import require_unchanged
    from ..scoring.evaluate import SCORES_ALONE, evaluate
    from ..scoring.metrics.measures import MEASURES
    from ..scoring.metrics.protocols import protocol
    from ..scoring.score_record import record_of, scored
    from ..store.seal import write_sealed
    from ..suites.suite import metrics
    from .showing import say_without_weights

    rules, run, path = protocol("default"), model.run, folder / "score.json"
    say_without_weights([rules])
    with progress_for_stderr() as progress:
        advance = partial(progress.advance, "scoring")
        result = evaluate(model.trained, run.scene, rules, run.device, advance, SCORES_ALONE, model.method)
    require_unchanged(run.scene, checksum_now)
    found = {rules.name: scored(rules, result.metrics, result.albedo_scale)}
    write_sealed(path, record_of(str(folder), model.method, run.scene, found))
    table, means = Table("metric", "value", "unit"), []
    for each in (one for one in metrics(*MAIN) if one.key in result.metrics):  # photos have no true albedo
        measure, metric = MEASURES[each.measure], result.metrics[each.key]
        value = f"n/a: {metric['reason']}" if metric["value"] is None else f"{metric['value']:.{measure.decimals}f}"
        table.add_row(f"{each.label} {ARROWS[measure.better]}", escape(value), measure.unit)
        means += [] if metric["value"] is None else [f"{each.label} {value} {measure.unit}".rstrip()]
    show(table)
    title = f"{run.scene.name}, {result.shown_view}   means of all test views: {', '.join(means)}"
    sheet = write_bands(folder, [(title, result.arrays, result.shown_light or "")])
    say(f"{len(result.metrics)} metrics, view by view: {path}", f"open {sheet}: maps of view {result.shown_view}")
    return sheet


def fields_of(name: str, preset: str, changes: Changes, config: Path | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """The fields of a method's variant and of its budget that a file or the command line sets. Raises UsageError, and
    DataError for a file that cannot be read."""
    from radiogs_core.plain_values import flat, leaf_names
    from radiogs_datasets.bounded_reading import read_toml

    from ..methods import method, settings_for

    used = method(name)
    try:
        kept = settings_for(used, preset, {} if config is None else flat(read_toml(config)))
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{config} is not valid TOML: {error}", "", f"`train` writes one: {SETTINGS}.") from error
    variant: dict[str, Any] = {}
    if changes.effects != "all":
        if "effects" not in leaf_names(used.variant()):
            raise no_effects(used.name)
        variant["effects"] = changes.effects
    found = settings_for(used, preset, changes.fields())
    return {**kept.variant, **variant, **found.variant}, {**kept.budget, **found.budget}


def render(
    folder: Path, /, *, relight: bool = False, views: Literal["test", "train"] = "test", opening: Opening = AS_TRAINED
) -> None:
    """Render the views of a trained model, and write its recovered light.

    Example:  radiogs-bench render out/corner --views test

    :param folder: Open the model that `train` left in this folder.
    :param relight: Render the test views under the scene's other lights, too, as `score` compares them; their albedo is
        scaled as by protocol default.
    :param views: Render the views of this split.
    """
    from radiogs_core.own_files import own_folder
    from radiogs_datasets.image_files import write_exr

    from ..export.views import write_relit_views, write_views
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.rendering import prepared
    from ..store.folder import Store

    with Store(folder).keeping_tracebacks():
        run, model = read_trained(folder, opening.use())
        name, place = read_about(folder)["method"], own_folder(folder / "render", folder)
        if model.light is not None:
            write_exr(place / "environment.exr", model.light.radiance.cpu().numpy())
        say(write_views(name, prepared(name, model), run, views, place))
        if relight:
            say(write_relit_views(name, model, run, place))
