"""Puts what somebody's files score into a finished run, as a row beside the measured ones.

The stored result also has the files' maps of one view, under the names of ``evaluate.Evaluation.arrays``.
"""

import hashlib
import time
from collections.abc import Callable, Sequence
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

from ..scoring.evaluate import LIGHTS_SHOWN, SHOWN
from ..scoring.kept_views import KeptViews, views_to_keep
from ..scoring.light_maps import light_maps
from ..scoring.metrics.protocols import protocol
from ..scoring.other_readings import with_other_readings
from ..scoring.score_files import score_predictions
from ..scoring.score_maps import coverage, lit_views, truth
from ..sources import code_digest
from ..store.folder import Store
from ..store.keys import canonical, content_key
from ..store.provenance import reset_peaks, session
from ..store.schema import MetricValue, Result
from .result import EVALUATE, add_stage, blank_result, data_of
from .rows_from_files import cell_content, measured, row_key, with_rows_from_files
from .scene_files import require_unchanged
from .sweep import Sweep, changing_sweep, read_sweep

CPU = torch.device("cpu")

PNG_BITS = 24
"""Where a PNG file says how many bits a channel has: after the signature, IHDR's head, width and height."""


@dataclass(frozen=True)
class NewRow:
    """A row to be added: its name, the seed it stands beside, and whether it may take the place of an earlier one."""

    name: str
    seed: int = 0
    force: bool = False


def scene_in_run(store: Store, sweep: Sweep, scene: Scene) -> str:
    """The name that a run has for a scene: the one of its finished cells with the same files, opened alike.

    Raises UsageError where there is none.
    """
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
    """Raise UsageError where a run has no place for a row, or has it already and it may not be replaced."""
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
    say: Callable[[str], None] = lambda line: None,
) -> Sweep:
    """Score files under a run's protocol, store the result, and enter it in the run's manifest, which is returned.

    ``digest`` digests the scene's files again; ``advance`` is called with (done, total) views, ``say`` with each remark
    on how the files are read. The cell is stored before the manifest names it: where the process dies in between, the
    next ``run`` enters it, or the same call does.

    Raises UsageError where the run has no such scene or seed, or has the row already; DataError for a folder without a
    run, for damaged files, and where the scene's files change meanwhile.
    """
    sweep = read_sweep(store.folder)
    name = scene_in_run(store, sweep, scene)
    require_room(store, sweep, row, name)
    predictions = with_other_readings(predictions, scene)
    for remark in predictions.remarks:
        say(f"remark: {remark}")
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
    row: NewRow,
    predictions: Predictions,
    scene: Scene,
    name: str,
    rules: str,
    advance: Callable[[int, int], None],
) -> tuple[Result, dict[str, np.ndarray]]:
    """The result of files of a scene, which the run calls ``name``, under the protocol ``rules``, and its arrays.

    Time and memory are in none of its keys: nobody here has measured them. ``seconds`` are those of scoring.
    """
    reset_peaks(CPU)
    with recording() as instruments:
        started = time.perf_counter()
        (score,) = score_predictions(predictions, scene, [protocol(rules)], advance)
        shown = shown_files(predictions, scene, score.albedo_scale)
        seconds = time.perf_counter() - started
    loader = code_digest(*scene.loaders)
    cell = cell_content(
        row.name, digest_of(predictions), {"checksum": scene.checksum, "loader": loader}, row.seed, rules
    )
    result = blank_result(content_key(cell), name, cell, score.protocol.describe())
    result["metrics"] = comparable(score.metrics, scene)
    result["views"], result["data"] = [view.name for view in scene.test], data_of(scene)
    result["shown_view"], result["shown_light"], result["albedo_scale"] = shown.view, shown.light, score.albedo_scale
    result["facts"], result["maps"] = facts_of(row, predictions), maps_of(predictions)
    add_stage(result, EVALUATE, instruments, seconds, [session(CPU)])
    return result, shown.arrays


@dataclass(frozen=True)
class ShownFiles:
    """``arrays`` of the middle test view, under ``light`` for its relit map; None if no file shows that."""

    view: str
    light: str | None
    arrays: dict[str, np.ndarray]


def shown_files(predictions: Predictions, scene: Scene, albedo_scale: Sequence[float] | None) -> ShownFiles:
    """``render/<map>`` and ``truth/<map>`` of the middle test view, float32 [height, width, channels], on black.

    Albedo is linear and multiplied by ``albedo_scale``. ``views/...`` as ``KeptViews`` keeps them, as many as fit its
    limit. Raises DataError for a damaged file.
    """
    view = scene.test[len(scene.test) // 2]
    mask = coverage(view)
    arrays = {f"truth/{name}": truth(view, name) for name in SHOWN if view.has(name)}
    maps = predictions.read(view, mask)
    arrays |= {f"render/{name}": maps[name] for name in (*SHOWN, "incident") if name in maps}
    if "albedo" in maps and albedo_scale is not None:
        arrays["render/albedo"] = maps["albedo"] * torch.tensor(albedo_scale, dtype=maps["albedo"].dtype)
    lit = {} if scene.surrounded else lit_views(scene, scene.test)
    first = next((light for light, views in lit.items() if view in views), None)
    shown_light = None
    for index, (light, views) in enumerate(lit.items()):
        if view not in views or view.name not in predictions.relit.get(light, {}):
            continue
        image, target = predictions.read_relit(light, view, mask), truth(view, f"relit/{light}")
        if light == first:
            shown_light = light
            arrays |= {"render/relit": image, "truth/relit": target}
        if index < LIGHTS_SHOWN:
            arrays |= {f"render/relit/{light}": image, f"truth/relit/{light}": target}
    found = predictions.read_light()
    if found is not None and scene.training_light is not None:
        arrays |= light_maps(found, scene.training_light)
    shown = {name: image.cpu().numpy().astype(np.float32) for name, image in arrays.items()}
    return ShownFiles(view.name, shown_light, shown | kept_files(predictions, scene, albedo_scale).codes)


def kept_files(predictions: Predictions, scene: Scene, albedo_scale: Sequence[float] | None) -> KeptViews:
    """Every map and light of as many test views as fit the limit."""
    kept = views_to_keep(scene, None)
    lit = {} if scene.surrounded else lit_views(scene, scene.test)
    for view in (view for view in scene.test if view.name in kept.chosen):
        maps = dict(predictions.read(view, coverage(view)))
        if "albedo" in maps and albedo_scale is not None:
            maps["albedo"] = maps["albedo"] * torch.tensor(albedo_scale, dtype=maps["albedo"].dtype)
        kept.rendered(view, maps)
        for light, views in lit.items():
            if view in views and view.name in predictions.relit.get(light, {}):
                image = predictions.read_relit(light, view, coverage(view))
                kept.relit(view, light, image, truth(view, f"relit/{light}"))
    return kept


def comparable(metrics: dict[str, MetricValue], scene: Scene) -> dict[str, MetricValue]:
    """The metrics; those of relit views are withheld where measured rows are scored on views elsewhere, too."""
    if not scene.relight:
        return metrics
    reason = "measured rows are relit on views of other scenes as well, which a folder of this scene does not hold"
    return {
        metric: MetricValue(value=None, reason=reason, views=each["views"])
        if metric.partition("/")[0] == "relight" else each
        for metric, each in metrics.items()
    }  # fmt: skip


def maps_of(predictions: Predictions) -> list[str]:
    """Maps that the files have of any view, ``relit`` and ``environment`` among them."""
    found = {name for maps in predictions.maps.values() for name in maps}
    found |= {"relit"} if any(predictions.relit.values()) else set()
    return sorted(found | ({"environment"} if predictions.light is not None else set()))


def facts_of(row: NewRow, predictions: Predictions) -> dict[str, Any]:
    """Facts about the files; ``labels`` stand below the tables."""
    labels = {
        "source": f"scored from files, read as {predictions.code} writes them; what trained it is not known here",
        "files": ", ".join(formats_of(predictions)),
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
    """SHA-256 of the files that are read, their paths and what they are read as: other files are another cell."""
    digests = {}
    for name, path in files_of(predictions).items():
        with path.open("rb") as file:
            digests[name] = hashlib.file_digest(file, "sha256").hexdigest()
    ground = {} if predictions.ground is None else {"ground": predictions.ground}
    return hashlib.sha256(canonical({"read_as": predictions.code, "files": digests, **ground})).hexdigest()


def formats_of(predictions: Predictions) -> list[str]:
    """Kinds of files, such as "PNG of 8 bits": what rounding the scores contain."""
    return sorted({_format(path) for path in files_of(predictions).values()})


def _format(path: Path) -> str:
    kind = path.suffix.removeprefix(".").upper()
    if kind != "PNG":
        return kind
    with path.open("rb") as file:
        header = file.read(PNG_BITS + 1)
    return f"PNG of {header[PNG_BITS]} bits"
