"""``radiogs-bench score``: score a trained model, or another code's output folder, under a named protocol."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from radiogs_core.errors import UsageError
from radiogs_datasets.options import AS_STORED, SceneOptions

from ..runs.progress import progress_for_stderr
from .options import AS_TRAINED, CodeName, Json, Opened, Opening, ProtocolName, SceneName
from .reporter import say, say_whole

if TYPE_CHECKING:
    import torch

    from radiogs_baselines.outputs.predictions import Predictions
    from radiogs_baselines.outputs.stanford_orb import Pair
    from radiogs_core.scene.scene import Scene

    from ..scoring.metrics.protocol import Protocol

ORB = "stanford-orb"

ROW = Group(
    "A row of a finished run",
    help="The files are scored as the run is, and become a row of its tables, figures and page.",
    sort_key=1,
)


@dataclass(frozen=True)
class Compared:
    """How a folder of images is read, with what they are compared, and how."""

    scene: SceneName | None = None
    """Compare with this scene, by name or folder."""
    code: Annotated[CodeName | None, Parameter(name="--from")] = None
    """Read the folder as this code writes it: radiogs, irgs, gs-ir, gi-gs, r3dg, svg-ir, tensoir, ptir-gs, stanford-orb
    or plain (default: recognised from its files)."""
    ground: Literal["white", "black"] | None = None
    """Read colours without a fourth channel on this ground (default: as the code writes them)."""
    protocol: ProtocolName | None = None
    """Score under this metric protocol, or under all (default: default; with --into the run's)."""

    def predictions(self, folder: Path, scene: "Scene") -> "Predictions":
        """The predictions in the folder, on the ground that was named."""
        from radiogs_baselines.outputs.reading import read_predictions

        from ..scoring.other_readings import with_other_readings

        found = read_predictions(folder, scene, self.code)
        return with_other_readings(found if self.ground is None else found.on_ground(self.ground), scene)


@dataclass(frozen=True)
class AsRow:
    """The options of a row in a run."""

    into: Path | None = None
    """Add the row to the run in this folder; --scene has to be one of its scenes."""
    row: str | None = None
    """Call the row by this name in tables."""
    seed: int | None = None
    """Compare the row with this seed of the run (default: 0)."""
    force: bool = False
    """Replace the row's cell of this scene and seed."""


def score(
    folder: Path,
    /,
    *,
    compared: Annotated[Compared, Parameter(name="*")] = Compared(),
    as_json: Json = False,
    out: Path | None = None,
    as_row: Annotated[AsRow, Parameter(name="*", group=ROW)] = AsRow(),
    opening: Opening = AS_TRAINED,
    opened: Opened = AS_STORED,
) -> None:
    """Score a trained model, or a folder of images that any code wrote.

    Example:  radiogs-bench score out/irgs --scene corner --from irgs

    :param folder: Score the model of `train`, or a code's output, in this folder.
    :param as_json: Print the record instead of the table.
    :param out: Write the record to this file.
    """
    from ..scoring.metrics.protocols import PROTOCOLS, protocol
    from ..store.seal import write_sealed
    from .showing import say_without_weights, show_record

    if as_row.into is not None:
        if given := "json" * as_json or "out" * (out is not None):
            raise UsageError(
                f"--{given} does not go with --into",
                "The run's reports and `export` hold what was scored.",
                f"Leave --{given} out, or score the folder by itself.",
            )
        score_into(as_row.into, as_row, folder, compared, opened)
        return
    if alone := [name for name, value in vars(as_row).items() if value is not None and value is not False]:
        raise UsageError(
            f"--{alone[0]} needs --into", "It describes a row of a run.", "Name the run's folder:  --into OUT"
        )
    protocols = list(PROTOCOLS.values()) if compared.protocol == "all" else [protocol(compared.protocol or "default")]
    if compared.code is None and compared.scene is None and (folder / "trained.json").exists():
        _leave_out_ground(compared)
        record = _of_model(folder, protocols, opening.use())
    elif _are_pairs(folder, compared):
        _leave_out_ground(compared)
        record = _of_pairs(folder, compared.scene, protocols)
    else:
        record = _of_files(folder, compared, opened, protocols)
    say_without_weights(protocols)
    if out is not None:
        write_sealed(out, record)
    if as_json:
        say_whole(json.dumps(record, indent=1, sort_keys=True, allow_nan=False))
    else:
        show_record(record)


def _leave_out_ground(compared: Compared) -> None:
    if compared.ground is not None:
        raise UsageError(
            "--ground goes with the folder of a code's images of a scene",
            "A model is rendered on its own ground, and pairs of files name their masks.",
            "Leave --ground out.",
        )


def _of_model(folder: Path, protocols: "Sequence[Protocol]", device: "torch.device") -> dict[str, Any]:
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.evaluate import SCORES_ALONE, evaluate
    from ..scoring.score_record import record_of, scored

    method, found = read_about(folder)["method"], {}
    run, model = read_trained(folder, device)
    with progress_for_stderr() as progress:
        for rules in protocols:
            advance = partial(progress.advance, "scoring")
            result = evaluate(model, run.scene, rules, run.device, advance, SCORES_ALONE, method)
            found[rules.name] = scored(rules, result.metrics, result.albedo_scale)
    return record_of(str(folder), method, run.scene, found)


def _are_pairs(folder: Path, compared: Compared) -> bool:
    """Whether the folder holds pairs of output and target: by ``--from``, or without options by its files."""
    from radiogs_baselines.outputs.reading import likely_codes
    from radiogs_baselines.outputs.stanford_orb import holds_pairs

    if compared.code is not None or compared.scene is not None:
        return compared.code == ORB
    return holds_pairs(folder) and not likely_codes(folder)


def _of_files(
    folder: Path, compared: Compared, opened: SceneOptions, protocols: "Sequence[Protocol]"
) -> dict[str, Any]:
    from radiogs_datasets import load_scene

    from ..scoring.score_files import score_predictions
    from ..scoring.score_record import NOTES, record_of, scored

    if compared.scene is None:
        raise UsageError(
            "no scene was named", "The ground truth is read from it.", "Add --scene PATH (or --from stanford-orb)."
        )
    scene = load_scene(compared.scene, options=opened)
    predictions = compared.predictions(folder, scene)
    with progress_for_stderr() as progress:
        scores = score_predictions(predictions, scene, protocols, partial(progress.advance, "scoring"))
    by_protocol = {each.protocol.name: scored(each.protocol, each.metrics, each.albedo_scale) for each in scores}
    notes = {name: getattr(predictions, name) for name in NOTES}
    return record_of(str(folder), predictions.code, scene, by_protocol, predictions.files, **notes)


def _of_pairs(folder: Path, scene: str | None, protocols: "Sequence[Protocol]") -> dict[str, Any]:
    from radiogs_baselines.outputs.stanford_orb import read_pairs, unread

    from ..scoring.score_orb import files_of, score_pairs
    from ..scoring.score_record import record_of, scored

    if scene is not None:
        raise UsageError(
            "--scene does not go with --from stanford-orb",
            "Its pairs of files name their own targets.",
            "Leave --scene out; or name the code that wrote the folder to score it against a scene.",
        )
    pairs = read_pairs(folder)
    unmasked = {pair.capture for pair in pairs if not pair.lacking and pair.task != "shape" and pair.mask is None}
    return record_of(
        str(folder),
        ORB,
        None,
        {rules.name: scored(rules, score_pairs(pairs, rules)) for rules in protocols},
        files_of(pairs),
        remarks=[
            *(f"{capture}: no mask, the whole image counts" for capture in sorted(unmasked)),
            *(f"{capture}, {task}: {said}" for capture, task, said in not_predicted(pairs)),
        ],
        missing=[f"{pair.capture}, {pair.task}: {path}" for pair in pairs for path in pair.lacking],
        ignored=unread(folder, pairs),
    )


def not_predicted(pairs: "Sequence[Pair]") -> list[tuple[str, str, str]]:
    """Sentences on pairs whose output is null: capture and task, and how they are scored; each once."""
    white = "null counts as a white image under stanford-orb, as its evaluator has it, and is n/a under other protocols"
    return sorted(
        {
            (pair.capture, pair.task, white if pair.counts_as_white else "null is left out")
            for pair in pairs
            if not pair.predicted
        }
    )


def score_into(into: Path, as_row: AsRow, folder: Path, compared: Compared, opened: SceneOptions) -> None:
    """Score the folder, enter the row into the run in ``into``, and rebuild and print its reports."""
    from radiogs_datasets import load_scene

    from ..runs.rows_from_files import NewRow, add_row, require_room, row_key, scene_in_run
    from ..runs.scene_checksum import checksum_now
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .showing import write_and_show

    if as_row.row is None:
        raise UsageError("the row has no name", "It stands in the run's tables.", "Add --row NAME")
    if compared.scene is None or compared.code == ORB:
        raise UsageError(
            "no scene was named",
            "A row is scored against the ground truth of one of the run's scenes, view by view.",
            "Add --scene PATH (pairs of files, as Stanford-ORB's, name their own targets and cannot be a row).",
        )
    store, sweep = Store(into), read_sweep(into)
    row = NewRow(as_row.row, as_row.seed or 0, as_row.force)
    row_key(row.name)  # a name that cannot be one shows before anything is read
    if compared.protocol not in (None, sweep["protocol"]):
        raise UsageError(
            f"{into} was scored under protocol '{sweep['protocol']}', not '{compared.protocol}'",
            "Metrics of two protocols cannot stand in one table.",
            "Leave --protocol out; or run the suite under the other protocol, into another folder.",
        )
    scene = load_scene(compared.scene, options=opened)
    require_room(store, sweep, row, scene_in_run(store, sweep, scene))
    predictions = compared.predictions(folder, scene)
    for remark in predictions.remarks:
        say(f"remark: {remark}")
    with progress_for_stderr() as progress:
        sweep = add_row(store, row, predictions, scene, checksum_now, partial(progress.advance, "scoring"))
    for heading in ("absent", "missing", "ignored"):
        for line in getattr(predictions, heading):
            say(f"{heading.removesuffix('s')}: {line}")
    write_and_show(store, sweep)
