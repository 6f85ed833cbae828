"""``radiogs-bench score``: score another code's output folder under a named protocol."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radiogs_core.errors import UsageError

from .options import add_scene_options, add_verbose, scene_options

if TYPE_CHECKING:
    from rich.table import Table

    from ..store.schema import MetricValue
    from .options import Commands

SCHEMA = "radiogs-bench/score/1"
ORB = "stanford-orb"
NOTES = ("remarks", "absent", "missing", "ignored")


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = commands.add_parser("score", help="score a folder that any code wrote", allow_abbrev=False)
    parser.set_defaults(command=score)
    parser.add_argument("predictions", type=Path, metavar="PREDICTIONS", help="what the code wrote")
    parser.add_argument("--scene", metavar="PATH", help="the scene that was trained on: its name or folder")
    parser.add_argument(
        "--from",
        dest="code",
        metavar="CODE",
        help="radiogs, irgs, gs-ir, gi-gs, r3dg, svg-ir, tensoir, stanford-orb, plain (default: told by the folder)",
    )
    add_scene_options(parser)
    parser.add_argument("--protocol", default="default", help="a metric protocol, or all (default: default)")
    parser.add_argument("--json", action="store_true", help="print the record instead of the table")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the record")
    add_verbose(parser)


def score(options: argparse.Namespace) -> int:
    """Score, print what was compared and what was missing, and write the record."""
    from ..metrics.weights import complaint
    from ..store.atomic import write_atomically
    from .reporter import complain, say, show

    record = _pairs(options) if _are_pairs(options) else _folder(options)
    for net in dict.fromkeys(each.net for rules in _protocols(options.protocol) for each in rules.lpips):
        if complaint(net):
            complain(complaint(net))
    text = json.dumps(record, indent=1, sort_keys=True, allow_nan=False) + "\n"
    if options.out is not None:
        write_atomically(options.out, text.encode())
    if options.json:
        say(text.rstrip())
        return 0
    show(_table(record))
    for heading in NOTES:
        for line in record[heading]:
            say(f"{heading.removesuffix('s')}: {line}")
    return 0


def _are_pairs(options: argparse.Namespace) -> bool:
    """Whether the folder holds pairs of output and target: if ``--from`` says so or, without options, by its files."""
    from radiogs_baselines.outputs import likely_codes
    from radiogs_baselines.outputs.stanford_orb import holds_pairs

    if options.code is not None or options.scene is not None:
        return bool(options.code == ORB)
    return holds_pairs(options.predictions) and not likely_codes(options.predictions)


def _protocols(name: str) -> list[Any]:
    from ..metrics import PROTOCOLS, protocol

    return list(PROTOCOLS.values()) if name == "all" else [protocol(name)]


def _folder(options: argparse.Namespace) -> dict[str, Any]:
    from radiogs_baselines.outputs import read_predictions
    from radiogs_datasets import load_scene

    from ..evaluation.score import score_predictions
    from ..training.progress import progress_for_stderr

    if options.scene is None:
        raise UsageError(
            "no scene was named", "The ground truth is read from it.", "Add --scene PATH (or --from stanford-orb)."
        )
    protocols = _protocols(options.protocol)
    scene = load_scene(options.scene, options=scene_options(options))
    predictions = read_predictions(options.predictions, scene, options.code)
    with progress_for_stderr() as progress:
        scores = score_predictions(
            predictions, scene, protocols, lambda done, total: progress.advance("scoring", done, total)
        )
    return {
        **_head(options, predictions.code),
        "scene": {"name": scene.name, "layout": scene.layout, "checksum": scene.checksum},
        "views": [view.name for view in scene.test],
        "files": predictions.files,
        "protocols": {
            each.protocol.name: {
                "conventions": each.protocol.describe(),
                "metrics": each.metrics,
                "albedo_scale": each.albedo_scale,
            }
            for each in scores
        },
        "remarks": list(predictions.remarks),
        "absent": list(predictions.absent),
        "missing": list(predictions.missing),
        "ignored": list(predictions.ignored),
    }


def _pairs(options: argparse.Namespace) -> dict[str, Any]:
    from radiogs_baselines.outputs.stanford_orb import read_pairs, unread

    from ..evaluation.score_orb import files_of, score_pairs

    if options.scene is not None:
        raise UsageError(
            "--scene does not go with --from stanford-orb",
            "Its pairs of files name their own targets.",
            "Leave --scene out; or name the code that wrote the folder to score it against a scene.",
        )
    pairs = read_pairs(options.predictions)
    unmasked = {pair.capture for pair in pairs if not pair.lacking and pair.task != "shape" and pair.mask is None}
    return {
        **_head(options, ORB),
        "scene": None,
        "views": [],
        "files": files_of(pairs),
        "protocols": {
            rules.name: {"conventions": rules.describe(), "metrics": score_pairs(pairs, rules), "albedo_scale": None}
            for rules in _protocols(options.protocol)
        },
        "remarks": [f"{capture}: no mask, the whole image counts" for capture in sorted(unmasked)],
        "absent": [],
        "missing": [f"{pair.capture}, {pair.task}: {path}" for pair in pairs for path in pair.lacking],
        "ignored": unread(options.predictions, pairs),
    }


def _head(options: argparse.Namespace, code: str) -> dict[str, Any]:
    from ..store.provenance import versions

    return {"schema": SCHEMA, "predictions": str(options.predictions), "from": code, "versions": versions()}


def _table(record: dict[str, Any]) -> "Table":
    """A table of metrics by protocol; with a single protocol, missing values give their reason."""
    from rich.table import Table

    table = Table("metric", title=f"{record['predictions']} ({record['from']})")
    for name in record["protocols"]:
        table.add_column(name, justify="right")
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
