"""``radiogs-bench rehearse``: takes few steps of every phase of a long run, and forecasts the whole."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from radiogs_core.errors import UsageError, unknown
from radiogs_datasets.options import AS_STORED, SceneOptions

from .options import (
    ON_CPU,
    Computing,
    Count,
    Data,
    Json,
    MethodNames,
    Opened,
    PresetName,
    ProtocolName,
    SceneNames,
    SuiteOrScene,
    Trust,
)
from .reporter import say, say_whole
from .values import factor, from_text, names, positive

if TYPE_CHECKING:
    from radiogs_core.scene.scene import Scene

    from ..lab.rehearsal.plan import Plan, RehearsedRow
    from ..suites.suite import Suite

GIB = 2**30
RESERVE = 0.9
"""Share of the free memory that a run may take."""

STOPPED = 130
ONE_SCENE = "one"
"""Name of the suite that a single scene is rehearsed as."""


def sizes_of(text: str) -> tuple[int, ...]:
    """Sizes of the model, in ascending order."""
    return tuple(sorted(positive(each) for each in names(text)))


def views_and_pixels(text: str) -> tuple[int, int, int]:
    """Views, width and height, such as 100x800x800."""
    found = re.fullmatch(r"(\d+)x(\d+)x(\d+)", text)
    if found is None or min(map(int, found.groups())) < 1:
        raise ValueError(f"'{text}' is not VIEWSxWIDTHxHEIGHT, such as 100x800x800")
    views, width, height = map(int, found.groups())
    return views, width, height


@dataclass(frozen=True)
class Asked:
    """Options of a rehearsal."""

    preset: PresetName = "paper"
    """Take the amount of work of this preset."""
    scenes: SceneNames = ()
    """Rehearse a suite on the first of these scenes, and forecast all (default: the suite's)."""
    method: MethodNames = ()
    """Rehearse these methods (default: the rows', or radiogs)."""
    trust: Trust = ()
    protocol: ProtocolName = ""
    """Score under this metric protocol (default: the suite's)."""
    enlarged: Annotated[
        tuple[int, int, int] | None, from_text(views_and_pixels), Parameter(name="--as", metavar="VIEWSxWIDTHxHEIGHT")
    ] = None
    """Repeat and enlarge the scene's views to this number and size, in memory."""
    test_views: Count = 8
    """With --as, test on N views; the forecast of the whole run counts as many."""
    no_masks: bool = False
    """With --as, leave out the coverage of the views."""
    minutes: float = 60.0
    """Start no larger size after this many minutes."""
    sizes: Annotated[tuple[int, ...], from_text(sizes_of), Parameter(metavar="N,N")] = ()
    """Rehearse models of these sizes (default: from the size at the start up to the largest)."""
    core_seconds: bool = False
    """Measure CPU time of one thread instead of wall time, for a machine that others use too."""
    memory: Annotated[float | None, from_text(factor)] = None
    """Count with so many GiB of memory (default: 90 % of what is free)."""
    forecast_for: str | None = None
    """Forecast for this device, such as rtx-4090."""
    out: Path | None = None
    """Write rehearsal.json to this folder (default: out/rehearse-NAME)."""
    as_json: Json = False
    """Print the record instead of tables."""


def rehearse(
    subject: SuiteOrScene,
    /,
    *,
    asked: Annotated[Asked, Parameter(name="*")] = Asked(),
    data: Data = None,
    opened: Opened = AS_STORED,
    on: Computing = ON_CPU,
) -> int:
    """Take a few steps of every phase at full size, and forecast the whole run.

    The exit code is 1 if something will not fit.

    Example:  radiogs-bench rehearse corner --as 100x800x800 --preset paper

    :param subject: Rehearse all rows of this suite, or one method on this scene.
    """
    from radiogs_datasets import load_scene

    from ..lab.rehearsal.climb import climb, stopped_by_signals
    from ..lab.rehearsal.record import fits, lines_of, record_of
    from ..runs.preflight import COMPILED_ON, compile_kernels
    from ..runs.progress import LogProgress
    from ..store.seal import write_sealed

    plan = _plan(subject, asked, opened, on)
    folder = asked.out or Path("out") / f"rehearse-{plan.name}"
    folder.mkdir(parents=True, exist_ok=True)
    compile_kernels(load_scene(COMPILED_ON), plan.device, ((row.method, row.variant) for row in plan.rows))
    with stopped_by_signals():
        climbed = climb(plan, folder, LogProgress())
    record = record_of(plan, climbed)
    write_sealed(folder / "rehearsal.json", record)
    if asked.as_json:
        say_whole(json.dumps(record, allow_nan=False))
    else:
        say(*lines_of(record), f"wrote {folder / 'rehearsal.json'}")
    if climbed.stopped:
        return STOPPED
    return 0 if fits(record) else 1


def _plan(subject: str, asked: Asked, opened: SceneOptions, on: Computing) -> "Plan":
    """The rows, the scene and the bounds. Raises UsageError for options that do not go together."""
    from radiogs_datasets import load_scene

    from ..lab.rehearsal.limits import KNOWN_DEVICES, memory_there
    from ..lab.rehearsal.plan import Plan
    from ..scoring.metrics.protocols import protocol

    if asked.forecast_for is not None and asked.forecast_for not in KNOWN_DEVICES:
        raise unknown("device", asked.forecast_for, KNOWN_DEVICES)
    if asked.core_seconds and (on.device != "cpu" or on.threads != 1):
        raise UsageError(
            "--core-seconds needs one CPU thread", "CPU time says nothing of several threads or of a GPU.",
            "Add --threads 1, and leave --device cuda out.",
        )  # fmt: skip
    device = on.use()
    suite, scenes = _suite(subject, asked)
    scene = _enlarged(load_scene(scenes[0], options=opened), asked)
    rules = protocol(asked.protocol or suite.protocol).name
    memory = {where: int(RESERVE * amount) for where, amount in memory_there(device).items()}
    if asked.memory is not None:
        memory["host"] = int(asked.memory * GIB)
    return Plan(
        name=scene.name if suite.name == ONE_SCENE else suite.name,
        preset=asked.preset,
        rows=_rows(suite, scene, asked.preset, rules, on.device),
        scene=scene,
        protocol=rules,
        cells=len(scenes),
        device=device,
        memory=memory,
        seconds=60 * asked.minutes,
        sizes=asked.sizes,
        clock="core" if asked.core_seconds else "wall",
        other_device=asked.forecast_for,
    )


def _suite(subject: str, asked: Asked) -> "tuple[Suite, Sequence[str]]":
    """The suite, or one that has a row of one method for the scene that is named, and the scenes of the whole run."""
    from ..runs.rows import of_methods
    from ..suites.registry import SUITES
    from ..suites.registry import suite as suite_of
    from ..suites.scenes import own_scenes
    from ..suites.suite import Metric, Row, Suite

    scenes: Sequence[str] = asked.scenes
    if subject in SUITES or subject.endswith(".toml"):
        suite = suite_of(subject)
    else:
        suite = Suite(ONE_SCENE, "One scene", None, None, (Row("ours", "", "ours"),), (Metric("nvs", "psnr"),))
        scenes = [subject]
    suite = of_methods(suite, asked.method) if asked.method else suite
    return suite, scenes or own_scenes(suite)


def _rows(suite: "Suite", scene: "Scene", preset: str, protocol: str, device: str) -> "list[RehearsedRow]":
    """The rows of a suite on a scene. Raises UsageError for a suite whose rows train nothing."""
    from ..lab.rehearsal.plan import RehearsedRow
    from ..runs.plan import planned
    from ..runs.spec import RunSpec

    plan = planned(suite, {scene.name: scene}, RunSpec(suite.name, preset=preset, protocol=protocol, device=device))
    by_key = {row.key: row for row in suite.rows}
    rows = []
    for ref, cell in plan.cells:
        if not cell.stages:
            raise UsageError(f"suite '{suite.name}' trains nothing", "There is nothing to rehearse.")
        method = plan.method(by_key[ref["row"]].method)
        rows.append(RehearsedRow(ref["row"], method, cell.found_as, cell.variant, cell.budget))
    return rows


def _enlarged(scene: "Scene", asked: Asked) -> "Scene":
    if asked.enlarged is None:
        if asked.no_masks:
            raise UsageError("--no-masks needs an enlarged scene", "", "Add --as VIEWSxWIDTHxHEIGHT.")
        return scene
    from radiogs_datasets.enlargement import enlarged

    views, width, height = asked.enlarged
    return enlarged(scene, views, asked.test_views, width, height, not asked.no_masks)
