"""``radiogs-bench rehearse``: takes few steps of every phase of a long run, and forecasts the whole."""

import argparse
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import UsageError, unknown

from .options import (
    METHOD,
    PRESETS_HELP,
    add_device,
    add_scene_options,
    add_verbose,
    declare,
    names,
    positive,
    scene_options,
    suite_of,
)
from .trusting import add_trust

if TYPE_CHECKING:
    from radiogs_core.scene.scene import Scene

    from ..lab.rehearsal.plan import Plan, RehearsedRow
    from ..suites.suite import Suite
    from .options import Commands

GIB = 2**30
RESERVE = 0.9
"""Share of the free memory that a run may take."""

MINUTES = 60.0
STOPPED = 130
ONE_SCENE = "one"
"""Name of the suite that a single scene is rehearsed as."""

TEST_VIEWS = 8
"""Test views of an enlarged scene: the whole run's forecast counts as many."""


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "rehearse", "Take a few steps of every phase at full size, and forecast the whole run.",
        "rehearse corner --as 100x800x800 --preset paper",
    )  # fmt: skip
    parser.set_defaults(command=rehearse)
    parser.add_argument(
        "subject", metavar="SUITE|SCENE", help="Rehearse all rows of this suite, or one method on this scene."
    )
    parser.add_argument("--preset", default="paper", help=PRESETS_HELP.format("paper"))
    parser.add_argument(
        "--scenes", type=names, metavar="A,B",
        help="Rehearse a suite on the first of these scenes, and forecast all (default: the suite's).",
    )  # fmt: skip
    parser.add_argument(
        "--method", type=names, metavar="A,B", help=f"Rehearse these methods (default: the rows', or {METHOD})."
    )
    add_trust(parser)
    parser.add_argument("--protocol", help="Score under this metric protocol (default: the suite's).")
    parser.add_argument(
        "--as", dest="size", type=_size, metavar="VIEWSxWIDTHxHEIGHT",
        help="Repeat and enlarge the scene's views to this number and size, in memory.",
    )  # fmt: skip
    parser.add_argument(
        "--test-views", type=positive, default=TEST_VIEWS, metavar="N", help="With --as, test on N views (default: 8)."
    )
    parser.add_argument("--no-masks", action="store_true", help="With --as, leave out the coverage of the views.")
    parser.add_argument(
        "--minutes", type=float, default=MINUTES, metavar="M",
        help=f"Start no larger size after this many minutes (default: {MINUTES:g}).",
    )  # fmt: skip
    parser.add_argument(
        "--sizes", type=_sizes, metavar="N,N",
        help="Rehearse models of these sizes (default: from the size at the start up to the largest).",
    )  # fmt: skip
    parser.add_argument(
        "--core-seconds", action="store_true",
        help="Measure CPU time of one thread instead of wall time, for a machine that others use too.",
    )  # fmt: skip
    parser.add_argument(
        "--memory", type=float, metavar="GIB", help="Count with this much memory (default: 90 %% of what is free)."
    )
    parser.add_argument("--forecast-for", metavar="DEVICE", help="Forecast for this device, such as rtx-4090.")
    add_device(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="Write rehearsal.json to this folder (default: out/rehearse-NAME)."
    )
    parser.add_argument("--json", action="store_true", help="Print the record instead of tables.")
    add_scene_options(parser)
    add_verbose(parser)


def rehearse(options: argparse.Namespace) -> int:
    """Rehearse, write the record and print it; returns 1 if something will not fit."""
    from radiogs_datasets import load_scene

    from ..lab.rehearsal.climb import climb, stopped_by_signals
    from ..lab.rehearsal.record import fits, lines_of, record_of
    from ..runs.preflight import COMPILED_ON, compile_kernels
    from ..runs.progress import LogProgress
    from ..store.seal import write_sealed
    from .reporter import say, say_whole

    plan = _plan(options)
    folder = options.out or Path("out") / f"rehearse-{plan.name}"
    folder.mkdir(parents=True, exist_ok=True)
    compile_kernels(load_scene(COMPILED_ON), plan.device, ((row.method, row.variant) for row in plan.rows))
    with stopped_by_signals():
        climbed = climb(plan, folder, LogProgress())
    record = record_of(plan, climbed)
    write_sealed(folder / "rehearsal.json", record)
    if options.json:
        say_whole(json.dumps(record, allow_nan=False))
    else:
        for line in [*lines_of(record), f"wrote {folder / 'rehearsal.json'}"]:
            say(line)
    if climbed.stopped:
        return STOPPED
    return 0 if fits(record) else 1


def _plan(options: argparse.Namespace) -> "Plan":
    """The rows, the scene and the bounds. Raises UsageError for options that do not go together."""
    from radiogs_datasets import load_scene

    from ..lab.rehearsal.limits import KNOWN_DEVICES, memory_there
    from ..lab.rehearsal.plan import Plan
    from ..scoring.metrics.protocols import protocol
    from .device import chosen_device

    if options.forecast_for is not None and options.forecast_for not in KNOWN_DEVICES:
        raise unknown("device", options.forecast_for, KNOWN_DEVICES)
    if options.core_seconds and (options.device != "cpu" or options.threads != 1):
        raise UsageError(
            "--core-seconds needs one CPU thread", "CPU time says nothing of several threads or of a GPU.",
            "Add --threads 1, and leave --device cuda out.",
        )  # fmt: skip
    device = chosen_device(options)
    suite, scenes = _suite(options)
    scene = _enlarged(load_scene(scenes[0], options=scene_options(options)), options)
    rules = protocol(options.protocol or suite.protocol).name
    memory = {where: int(RESERVE * amount) for where, amount in memory_there(device).items()}
    if options.memory is not None:
        memory["host"] = int(options.memory * GIB)
    return Plan(
        name=scene.name if suite.name == ONE_SCENE else suite.name,
        preset=options.preset,
        rows=_rows(suite, scene, options.preset, rules, options.device),
        scene=scene,
        protocol=rules,
        cells=len(scenes),
        device=device,
        memory=memory,
        seconds=60 * options.minutes,
        sizes=options.sizes or (),
        clock="core" if options.core_seconds else "wall",
        other_device=options.forecast_for,
    )


def _suite(options: argparse.Namespace) -> "tuple[Suite, Sequence[str]]":
    """The suite, or one that has a row of one method for the scene that is named, and the scenes of the whole run."""
    from ..runs.rows import of_methods
    from ..suites.registry import SUITES
    from ..suites.scenes import own_scenes
    from ..suites.suite import Metric, Row, Suite

    if options.subject in SUITES or options.subject.endswith(".toml"):
        suite = suite_of(options.subject)
        scenes = options.scenes
    else:
        suite = Suite(ONE_SCENE, "One scene", None, None, (Row("ours", "", "ours"),), (Metric("nvs", "psnr"),))
        scenes = [options.subject]
    suite = of_methods(suite, options.method) if options.method else suite
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


def _enlarged(scene: "Scene", options: argparse.Namespace) -> "Scene":
    if options.size is None:
        if options.no_masks:
            raise UsageError("--no-masks needs an enlarged scene", "", "Add --as VIEWSxWIDTHxHEIGHT.")
        return scene
    from radiogs_datasets.enlargement import enlarged

    views, width, height = options.size
    return enlarged(scene, views, options.test_views, width, height, not options.no_masks)


def _sizes(text: str) -> list[int]:
    """Sizes of the model, in ascending order."""
    return sorted(positive(each) for each in names(text))


def _size(text: str) -> tuple[int, int, int]:
    """Views, width and height, such as 100x800x800."""
    found = re.fullmatch(r"(\d+)x(\d+)x(\d+)", text)
    if found is None or min(map(int, found.groups())) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not VIEWSxWIDTHxHEIGHT, such as 100x800x800")
    views, width, height = map(int, found.groups())
    return views, width, height
