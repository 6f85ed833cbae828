"""``radiogs-bench score``: score a trained model, or another code's output folder, under a named protocol.

With ``--into OUT``, what anybody's files score becomes a row of a finished run.
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .device import chosen_device
from .options import add_device, add_scene_options, add_verbose, declare, scene_options
from .trusting import add_trust

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from radiogs_baselines.outputs.predictions import Predictions
    from radiogs_baselines.outputs.stanford_orb import Pair
    from radiogs_core.scene.scene import Scene

    from ..scoring.metrics.protocol import Protocol
    from ..store.schema import MetricValue
    from .options import Commands

ORB = "stanford-orb"

GIVEN = ("row", "seed", "force")
"""Options that name a row of a run; they need ``--into``."""

PLAIN_SCORE = ("json", "out")
"""Options that do not go with ``--into``."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "score", "Score a trained model, or a folder of images that any code wrote.",
        "score out/irgs --scene corner --from irgs",
    )  # fmt: skip
    parser.set_defaults(command=score)
    parser.add_argument(
        "predictions", type=Path, metavar="FOLDER", help="Score the model of `train`, or a code's output, in FOLDER."
    )
    parser.add_argument("--scene", metavar="PATH", help="Compare with this scene, by name or folder.")
    parser.add_argument(
        "--from", dest="code", metavar="CODE",
        help="Read the folder as this code writes it: radiogs, irgs, gs-ir, gi-gs, r3dg, svg-ir, tensoir, stanford-orb"
        " or plain (default: recognised from its files).",
    )  # fmt: skip
    parser.add_argument(
        "--ground", choices=("white", "black"),
        help="Read colours without a fourth channel on this ground (default: as the code writes them).",
    )  # fmt: skip
    add_scene_options(parser)
    parser.add_argument(
        "--protocol", help="Score under this metric protocol, or under all (default: default; with --into the run's)."
    )
    add_trust(parser)
    add_device(parser)
    parser.add_argument("--json", action="store_true", help="Print the record instead of the table.")
    parser.add_argument("--out", type=Path, metavar="FILE", help="Write the record to FILE.")
    _add_row(parser)
    add_verbose(parser)


def _add_row(parser: argparse.ArgumentParser) -> None:
    """Add ``--into`` and the options of a row in a run."""
    group = parser.add_argument_group(
        "a row of a finished run",
        "The files are scored as the run is, and become a row of its tables, figures and page.",
    )
    group.add_argument(
        "--into", type=Path, metavar="OUT", help="Add the row to the run in OUT; --scene has to be one of its scenes."
    )
    group.add_argument("--row", metavar="NAME", help="Call the row NAME in tables.")
    group.add_argument("--seed", type=int, metavar="N", help="Compare the row with this seed of the run (default: 0).")
    group.add_argument(
        "--force", action="store_true", default=None, help="Replace the row's cell of this scene and seed."
    )


def score(options: argparse.Namespace) -> int:
    """Score, print what was compared and what was missing, and write the record."""
    from .reporter import say

    if is_row_of_a_run(options):
        return score_into(options)
    options.protocol = options.protocol or "default"
    record = _record(options)
    say_without_weights(_protocols(options.protocol))
    if options.out is not None:
        write_record(record, options.out)
    if options.json:
        say(text_of(record).rstrip())
    else:
        show_record(record)
    return 0


def _record(options: argparse.Namespace) -> dict[str, Any]:
    if options.ground is not None and (_is_trained(options) or _are_pairs(options)):
        raise UsageError(
            "--ground goes with the folder of a code's images of a scene",
            "A model is rendered on its own ground, and pairs of files name their masks.",
            "Leave --ground out.",
        )
    if _is_trained(options):
        return _model(options)
    return _pairs(options) if _are_pairs(options) else _folder(options)


def say_without_weights(protocols: "Sequence[Protocol]") -> None:
    """Warn of each network whose weights are missing: its metrics are n/a."""
    from ..scoring.metrics.weights import complaint
    from .reporter import complain

    for net in dict.fromkeys(each.net for rules in protocols for each in rules.lpips):
        if complaint(net):
            complain(complaint(net))


def text_of(record: dict[str, Any]) -> str:
    """The record as it is stored."""
    return json.dumps(record, indent=1, sort_keys=True, allow_nan=False) + "\n"


def write_record(record: dict[str, Any], path: Path) -> None:
    """Write the record to a file."""
    from ..store.seal import write_sealed

    write_sealed(path, record)


def show_record(record: dict[str, Any]) -> None:
    """Print a record's table and its notes."""
    from ..scoring.score_record import NOTES
    from .reporter import say, show

    show(_table(record))
    for heading in NOTES:
        for line in record[heading]:
            say(f"{heading.removesuffix('s')}: {line}")


def _is_trained(options: argparse.Namespace) -> bool:
    """Whether the folder holds a model of ``train``, and no option says otherwise."""
    return options.code is None and options.scene is None and (options.predictions / "trained.json").exists()


def _model(options: argparse.Namespace) -> dict[str, Any]:
    from ..runs.progress import progress_for_stderr
    from ..runs.trained_folder import read_about, read_trained
    from ..scoring.score_record import record_of_model

    protocols, folder = _protocols(options.protocol), options.predictions
    method = read_about(folder)["method"]
    run, model = read_trained(folder, chosen_device(options))
    with progress_for_stderr() as progress:
        return record_of_model(
            str(folder), method, model, run.scene, run.device, protocols,
            lambda done, total: progress.advance("scoring", done, total),
        )  # fmt: skip


def _are_pairs(options: argparse.Namespace) -> bool:
    """Whether the folder holds pairs of output and target, as ``--from`` or, without options, its files say."""
    from radiogs_baselines.outputs.reading import likely_codes
    from radiogs_baselines.outputs.stanford_orb import holds_pairs

    if options.code is not None or options.scene is not None:
        return bool(options.code == ORB)
    return holds_pairs(options.predictions) and not likely_codes(options.predictions)


def _protocols(name: str) -> list[Any]:
    from ..scoring.metrics.protocols import PROTOCOLS, protocol

    return list(PROTOCOLS.values()) if name == "all" else [protocol(name)]


def _folder(options: argparse.Namespace) -> dict[str, Any]:
    from radiogs_datasets import load_scene

    from ..runs.progress import progress_for_stderr
    from ..scoring.other_readings import with_other_readings
    from ..scoring.score_files import score_predictions
    from ..scoring.score_record import record_of, scored

    if options.scene is None:
        raise UsageError(
            "no scene was named", "The ground truth is read from it.", "Add --scene PATH (or --from stanford-orb)."
        )
    protocols = _protocols(options.protocol)
    scene = load_scene(options.scene, options=scene_options(options))
    predictions = with_other_readings(_predictions(options, scene), scene)
    with progress_for_stderr() as progress:
        scores = score_predictions(
            predictions, scene, protocols, lambda done, total: progress.advance("scoring", done, total)
        )
    return record_of(
        str(options.predictions),
        predictions.code,
        scene,
        {each.protocol.name: scored(each.protocol, each.metrics, each.albedo_scale) for each in scores},
        predictions.files,
        remarks=predictions.remarks,
        absent=predictions.absent,
        missing=predictions.missing,
        ignored=predictions.ignored,
    )


def _predictions(options: argparse.Namespace, scene: "Scene") -> "Predictions":
    """The predictions in the folder, on the ground that was named."""
    from radiogs_baselines.outputs.reading import read_predictions

    found = read_predictions(options.predictions, scene, options.code)
    return found if options.ground is None else found.on_ground(options.ground)


def _pairs(options: argparse.Namespace) -> dict[str, Any]:
    from radiogs_baselines.outputs.stanford_orb import read_pairs, unread

    from ..scoring.score_orb import files_of, score_pairs
    from ..scoring.score_record import record_of, scored

    if options.scene is not None:
        raise UsageError(
            "--scene does not go with --from stanford-orb",
            "Its pairs of files name their own targets.",
            "Leave --scene out; or name the code that wrote the folder to score it against a scene.",
        )
    pairs = read_pairs(options.predictions)
    unmasked = {pair.capture for pair in pairs if not pair.lacking and pair.task != "shape" and pair.mask is None}
    return record_of(
        str(options.predictions),
        ORB,
        None,
        {rules.name: scored(rules, score_pairs(pairs, rules)) for rules in _protocols(options.protocol)},
        files_of(pairs),
        remarks=[
            *(f"{capture}: no mask, the whole image counts" for capture in sorted(unmasked)),
            *(f"{capture}, {task}: {said}" for capture, task, said in not_predicted(pairs)),
        ],
        missing=[f"{pair.capture}, {pair.task}: {path}" for pair in pairs for path in pair.lacking],
        ignored=unread(options.predictions, pairs),
    )


def not_predicted(pairs: "Sequence[Pair]") -> list[tuple[str, str, str]]:
    """Capture and task of pairs whose output is null, and what becomes of them; each once."""
    white = "null counts as a white image under stanford-orb, as its evaluator has it, and is n/a under other protocols"
    return sorted(
        {
            (pair.capture, pair.task, white if pair.counts_as_white else "null is left out")
            for pair in pairs
            if not pair.predicted
        }
    )


def _table(record: dict[str, Any]) -> "Table":
    """A table of metrics by protocol; with a single protocol, missing values give their reason."""
    from rich.table import Table

    table = Table("metric", title=f"{record['predictions']} ({record['from']})")
    for each in record["protocols"].values():
        table.add_column(each["conventions"]["title"], justify="right")
    if len(record["protocols"]) == 1:
        table.add_column("why not")
    metrics = sorted({metric for each in record["protocols"].values() for metric in each["metrics"]})
    for metric in metrics:
        values = [each["metrics"].get(metric) for each in record["protocols"].values()]
        reasons = [(values[0] or {}).get("reason") or ""] if len(values) == 1 else []
        table.add_row(metric, *map(_shown, values), *reasons)
    return table


def _shown(metric: "MetricValue | None") -> str:
    if metric is None:
        return ""
    return "n/a" if metric["value"] is None else f"{metric['value']:.4f}"


def is_row_of_a_run(options: argparse.Namespace) -> bool:
    """Whether the options name a row of a run. Raises UsageError for options that do not go together."""
    if options.into is None:
        if alone := [name for name in GIVEN if getattr(options, name) is not None]:
            raise UsageError(
                f"--{alone[0]} needs --into", "It describes a row of a run.", "Name the run's folder:  --into OUT"
            )
        return False
    if options.row is None:
        raise UsageError("the row has no name", "It stands in the run's tables.", "Add --row NAME")
    if options.scene is None or options.code == "stanford-orb":
        raise UsageError(
            "no scene was named",
            "A row is scored against the ground truth of one of the run's scenes, view by view.",
            "Add --scene PATH (pairs of files, as Stanford-ORB's, name their own targets and cannot be a row).",
        )
    if given := [name for name in PLAIN_SCORE if getattr(options, name)]:
        raise UsageError(
            f"--{given[0]} does not go with --into",
            "The run's reports and `export` hold what was scored.",
            f"Leave --{given[0]} out, or score the folder by itself.",
        )
    return True


def score_into(options: argparse.Namespace) -> int:
    """Score the folder, enter the row, and rebuild and print the run's reports."""
    from radiogs_datasets import load_scene

    from ..runs.progress import progress_for_stderr
    from ..runs.rows_from_files import NewRow, add_row, require_room, row_key, scene_in_run
    from ..runs.scene_checksum import checksum_now
    from ..runs.sweep import read_sweep
    from ..scoring.other_readings import with_other_readings
    from ..store.folder import Store
    from .reporter import say
    from .showing import write_and_show

    store, sweep = Store(options.into), read_sweep(options.into)
    row = NewRow(options.row, options.seed or 0, bool(options.force))
    row_key(row.name)  # a name that cannot be one shows before anything is read
    require_same_protocol(options, sweep["protocol"])
    scene = load_scene(options.scene, options=scene_options(options))
    require_room(store, sweep, row, scene_in_run(store, sweep, scene))
    predictions = with_other_readings(_predictions(options, scene), scene)
    for remark in predictions.remarks:
        say(f"remark: {remark}")
    with progress_for_stderr() as progress:
        sweep = add_row(
            store, row, predictions, scene, checksum_now, lambda done, total: progress.advance("scoring", done, total)
        )
    for heading in ("absent", "missing", "ignored"):
        for line in getattr(predictions, heading):
            say(f"{heading.removesuffix('s')}: {line}")
    write_and_show(store, sweep)
    return 0


def require_same_protocol(options: argparse.Namespace, of_run: str) -> None:
    """Raise UsageError if ``--protocol`` is not the run's."""
    if options.protocol not in (None, of_run):
        raise UsageError(
            f"{options.into} was scored under protocol '{of_run}', not '{options.protocol}'",
            "Metrics of two protocols cannot stand in one table.",
            "Leave --protocol out; or run the suite under the other protocol, into another folder.",
        )
