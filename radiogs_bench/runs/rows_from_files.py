"""Rows of a run that are scored from another program's files (``score --into``).

Their cells are results like others: the key is over the files' digest in place of the method's sources. The training is
unknown, so variant, stages and training seconds are empty, and the budget is named ``UNKNOWN``. The store has all such
rows; a manifest lists the rows that can be compared with its run.
"""

import hashlib
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import torch

from radiogs_baselines.outputs.predictions import Predictions
from radiogs_core.errors import UsageError
from radiogs_core.instruments import recording
from radiogs_core.scene.scene import Scene

from ..scoring.metrics.protocols import protocol
from ..scoring.report_arrays import ReportArrays
from ..scoring.score_files import score_predictions
from ..scoring.score_maps import lit_views
from ..sources import code_digest
from ..store.folder import Store
from ..store.keys import canonical, content_key
from ..store.provenance import reset_peaks, session
from ..store.schema import MetricValue, Result
from ..suites.experiment import FROM_FILES
from .cell import evaluation_code
from .result import EVALUATE, add_stage, blank_result, data_of
from .sweep import CellRef, Sweep, TableRow, changing_sweep, read_sweep
from .unchanged_scene import require_unchanged

CPU = torch.device("cpu")

UNKNOWN = "not known"
"""Name of the budget of a row whose training is unknown."""

LONGEST_NAME = 80
PLAIN = re.compile(r"[A-Za-z0-9_.-]{1,60}")

PNG_BITS = 24
"""Offset of the bits per channel in a PNG file: after the signature, IHDR's head, width and height."""


@dataclass(frozen=True)
class NewRow:
    """A row to be added: its name, the seed it is compared with, and whether it may replace an earlier row."""

    name: str
    seed: int = 0
    force: bool = False


def scene_in_run(store: Store, sweep: Sweep, scene: Scene) -> str:
    """The run's name for a scene, found by finished cells with the same files and options. Raises UsageError."""
    checksums = checksums_of(store, measured(sweep))
    same = [name for name, checksum in checksums.items() if checksum == scene.checksum]
    if same:
        return scene.name if scene.name in same else same[0]
    if scene.name in checksums:
        raise UsageError(
            f"scene '{scene.name}' is not the one that {store.folder} has under that name",
            "Its files differ, or it was opened in another way (reduced, other views held out): metrics of two such"
            " scenes cannot stand in one table.",
            "Name the same folder, with the options that the run was started with.",
        )
    known = ", ".join(checksums) or "none"
    raise UsageError(
        f"{store.folder} has no finished cell of scene '{scene.name}'",
        f"A row is added beside measured ones of the same scene; there, finished: {known}.",
        "Name one of these, or finish the run first.",
    )


def checksums_of(store: Store, sweep: Sweep) -> dict[str, str]:
    """The checksum of each scene of which a cell is finished, by name."""
    found: dict[str, str] = {}
    for ref in sweep["cells"]:
        result = store.result(ref["key"]) if ref["scene"] not in found else None
        if result is not None:
            found[ref["scene"]] = result["cell"]["checksum"]
    return found


def require_room(store: Store, sweep: Sweep, row: NewRow, scene: str) -> None:
    """Raise UsageError if the run lacks the row's seed, or has the row already and may not replace it."""
    if row.seed not in sweep["seeds"]:
        raise UsageError(
            f"the run has no seed {row.seed}",
            f"Its seeds: {', '.join(map(str, sweep['seeds']))}. Rows are compared seed by seed.",
            "Name one of these:  --seed N",
        )
    key = row_key(row.name)
    for line in measured(sweep)["rows"]:
        if row.name in (line["text"], line["key"]):
            raise UsageError(
                f"'{row.name}' is a row that the run measures",
                "Files of others never take its place.",
                "Give the row another name:  --row NAME",
            )
    taken = any(
        (ref["row"], ref["scene"], ref["seed"]) == (key, scene, row.seed) and store.has_result(ref["key"])
        for ref in sweep["cells"]
    )
    if taken and not row.force:
        raise UsageError(
            f"row '{row.name}' is there already, for scene '{scene}' and seed {row.seed}",
            "What is finished is not replaced without being asked.",
            "Add --force to replace it, or give the row another name.",
        )


def add_row(
    store: Store,
    row: NewRow,
    predictions: Predictions,
    scene: Scene,
    digest: Callable[[Scene], str],
    advance: Callable[[int, int], None] = lambda done, total: None,
) -> Sweep:
    """Score files under a run's protocol, store the result, and enter it in the run's manifest, which is returned.

    ``digest`` digests the scene's files again; ``advance`` is called with (done, total) views. The cell is stored
    before the manifest names it: if the process dies in between, the next ``run`` or the same call enters it.

    Raises UsageError where the run has no such scene or seed, or has the row already; DataError for a folder without a
    run, for damaged files, and where the scene's files change meanwhile.
    """
    sweep = read_sweep(store.folder)
    name = scene_in_run(store, sweep, scene)
    require_room(store, sweep, row, name)
    result, arrays = scored_files(row, predictions, scene, name, sweep["protocol"], advance)
    require_unchanged(scene, digest)
    with changing_sweep(store) as write:
        sweep = read_sweep(store.folder)
        if sweep["protocol"] != result["cell"]["protocol"] or scene_in_run(store, sweep, scene) != name:
            raise UsageError(
                f"another run was started in {store.folder} meanwhile", "It has another protocol.", "Score again."
            )
        require_room(store, sweep, row, name)
        store.put_result(result, arrays)
        sweep, _ = with_rows_from_files(store, sweep, checksums_of(store, sweep))
        write(sweep)
    return sweep


def scored_files(
    row: NewRow, predictions: Predictions, scene: Scene, name: str, rules: str, advance: Callable[[int, int], None]
) -> tuple[Result, dict[str, np.ndarray]]:
    """The result of files of a scene, which the run calls ``name``, under the protocol ``rules``, and its arrays.

    The method is called ``NAME (files)``, so that nobody's files are taken for a method of that name that was run.
    Training time and memory are absent, because they were not measured. ``seconds``: the time of scoring.
    """
    cell = {
        "checksum": scene.checksum,
        "loader": code_digest(*scene.loaders),
        "method": f"{row.name} (files)",
        "variant": {},
        "budget": {"name": UNKNOWN},
        "seed": row.seed,
        "device": "cpu",
        "protocol": rules,
        "stages": {},
        "method_code": digest_of(predictions),
        "evaluation_code": evaluation_code(FROM_FILES),
        "experiment": FROM_FILES.name,
        "settings": {},
    }
    reset_peaks(CPU)
    with recording() as instruments:
        started = time.perf_counter()
        report = ReportArrays(scene, {} if scene.surrounded else lit_views(scene, scene.test), None)
        (score,) = score_predictions(predictions, scene, [protocol(rules)], advance, report)
        seconds = time.perf_counter() - started
    result = blank_result(content_key(cell), name, cell, score.protocol.describe())
    result["metrics"] = comparable(score.metrics, scene)
    result["views"], result["data"] = [view.name for view in scene.test], data_of(scene)
    result["shown_view"], result["shown_light"] = report.shown.name, report.shown_light
    result["albedo_scale"], result["facts"] = score.albedo_scale, facts_of(row, predictions)
    result["maps"] = sorted({kind.partition("/")[0] for kind, views in predictions.files.items() if views})
    add_stage(result, EVALUATE, instruments, seconds, [session(CPU)])
    return result, report.arrays


def comparable(metrics: dict[str, MetricValue], scene: Scene) -> dict[str, MetricValue]:
    """The metrics; relighting metrics are withheld if measured rows are also scored on views of other scenes."""
    if not scene.relight:
        return metrics
    reason = "measured rows are relit on views of other scenes as well, which a folder of this scene does not hold"
    return {
        metric: MetricValue(value=None, reason=reason, views=each["views"])
        if metric.partition("/")[0] == "relight" else each
        for metric, each in metrics.items()
    }  # fmt: skip


def facts_of(row: NewRow, predictions: Predictions) -> dict[str, Any]:
    """Facts about the files; ``labels`` are printed below the tables, kinds of files such as "PNG of 8 bits" too."""
    labels = {
        "source": f"scored from files, read as {predictions.code} writes them; what trained it is not known here",
        "files": ", ".join(sorted({_format(path) for path in files_of(predictions).values()})),
    }
    if predictions.remarks:
        labels["remarks"] = " ".join(predictions.remarks)
    return {
        "row": row.name,
        "read_as": predictions.code,
        "scored": datetime.now(UTC).isoformat(timespec="microseconds"),
        "folder": predictions.folder.name,
        "labels": labels,
        **{name: list(getattr(predictions, name)) for name in ("absent", "missing", "ignored", "remarks")},
    }


def files_of(predictions: Predictions) -> dict[str, Path]:
    """Every file that is read, by its path within the folder."""
    names = {name for views in predictions.files.values() for name in views.values()}
    return {name: predictions.folder / name for name in sorted(names)}


def digest_of(predictions: Predictions) -> str:
    """SHA-256 of the files that are read, their paths, and how they are read: other files make another cell."""
    digests = {}
    for name, path in files_of(predictions).items():
        with path.open("rb") as file:
            digests[name] = hashlib.file_digest(file, "sha256").hexdigest()
    ground = {} if predictions.ground is None else {"ground": predictions.ground}
    return hashlib.sha256(canonical({"read_as": predictions.code, "files": digests, **ground})).hexdigest()


def _format(path: Path) -> str:
    kind = path.suffix.removeprefix(".").upper()
    if kind != "PNG":
        return kind
    with path.open("rb") as file:
        header = file.read(PNG_BITS + 1)
    return f"PNG of {header[PNG_BITS]} bits"


def row_key(name: str) -> str:
    """Key of the row of a name. Names with unusual characters get a digest, so that no two names share a key.

    Raises UsageError for an empty or long name, and for one with line breaks or characters that cannot be printed.

    >>> row_key("gs-ir"), row_key("GS-IR, 30k")
    ('files-gs-ir', 'files-GS-IR-30k-a3b20f')
    """
    if name != name.strip() or not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
        raise UsageError(
            f"{name!r:.120} cannot be the name of a row",
            f"It is printed in tables: 1 to {LONGEST_NAME} printable characters on one line, no space at its ends.",
            "Give another one:  --row NAME",
        )
    if PLAIN.fullmatch(name):
        return f"files-{name}"
    words = "-".join(re.findall(r"[A-Za-z0-9_.]+", name))[:40]
    digest = hashlib.sha256(name.encode()).hexdigest()[:6]
    return "-".join(part for part in ("files", words, digest) if part)


def is_from_files(result: Result) -> bool:
    """Whether a result was scored from files."""
    return bool(result["cell"].get("experiment") == FROM_FILES.name)


def measured(sweep: Sweep) -> Sweep:
    """The manifest without rows scored from files."""
    rows = [row for row in sweep["rows"] if "files" not in row]
    keys = {row["key"] for row in rows}
    return {**sweep, "rows": rows, "cells": [ref for ref in sweep["cells"] if ref["row"] in keys]}


def with_rows_from_files(store: Store, sweep: Sweep, checksums: Mapping[str, str]) -> tuple[Sweep, list[str]]:
    """The manifest with every row scored from files that is in its store and can be compared with the run.

    ``checksums`` are the scenes' by name. A cell belongs if its scene, protocol and seed are the run's and this version
    of the code scored it; of several cells of one row, scene and seed, the last scored one. Also returned: names of the
    rows that another version scored, which have to be scored again.
    """
    own = measured(sweep)
    scene_of = {checksum: scene for scene, checksum in checksums.items()}
    code = evaluation_code(FROM_FILES)
    found: dict[tuple[str, str, int], Result] = {}
    outdated: set[str] = set()
    for result in store.results():
        cell = result["cell"]
        comparable = is_from_files(result) and cell["protocol"] == sweep["protocol"]
        if not comparable or cell["checksum"] not in scene_of or cell["seed"] not in sweep["seeds"]:
            continue
        if cell["evaluation_code"] != code:
            outdated.add(result["facts"]["row"])
            continue
        origin = (result["facts"]["row"], scene_of[cell["checksum"]], cell["seed"])
        if origin not in found or found[origin]["facts"]["scored"] <= result["facts"]["scored"]:  # UTC, ISO 8601
            found[origin] = result
    lines: dict[str, TableRow] = {}
    places: list[CellRef] = []
    for (name, scene, seed), result in sorted(found.items(), key=lambda each: each[0]):
        lines[name] = TableRow(key=row_key(name), latex="", text=name, files=str(result["facts"]["read_as"]))
        places.append(CellRef(row=row_key(name), scene=scene, seed=seed, key=result["key"], stages=[]))
    whole: Sweep = {**own, "rows": [*own["rows"], *lines.values()], "cells": [*own["cells"], *places]}
    return whole, sorted(outdated - lines.keys())
