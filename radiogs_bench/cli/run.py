"""``radiogs-bench run``: run a suite's cells, or continue them, then write and print its table.

The module is imported for ``--help``: what computes is imported by the functions that need it.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import DataError, ExplainedError, UsageError

from ..errors import explain, worst_exit_code
from ..runs.engines.choice import ENGINES, choose
from .device import chosen_device
from .options import (
    PRESETS_HELP,
    add_device,
    add_effects,
    add_recipe,
    add_scene_options,
    add_set,
    add_verbose,
    declare,
    differences,
    names,
    part_of,
    positive,
    scene_options,
    seeds,
    settings_from,
    suite_of,
    views_kept,
)
from .reporter import complain, say
from .trusting import add_trust

if TYPE_CHECKING:
    import torch

    from radiogs_core.scene.scene import Scene

    from ..runs.engines.choice import Engine
    from ..runs.sweep import Request, Sweep
    from ..store.folder import Store
    from ..suites.suite import Suite
    from .options import Commands


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = declare(
        commands, "run", "Run the cells of a suite, or continue them, and write and print its table.",
        "run ablations --preset smoke --scenes corner --seeds 2",
    )  # fmt: skip
    parser.set_defaults(command=run)
    parser.add_argument("suite", nargs="?", metavar="SUITE", help="Name a suite (see --list), or a TOML file.")
    parser.add_argument("--list", action="store_true", help="List the suites, or describe the named one; run nothing.")
    parser.add_argument(
        "--scenes", type=names, metavar="A,B", help="Run on these scenes, by name or folder (default: the suite's)."
    )
    parser.add_argument("--seeds", type=seeds, default=1, metavar="N", help="Run seeds 0 to N-1 (default: 1).")
    parser.add_argument(
        "--as-published", action="store_true",
        help="Run the published table that the suite reproduces: its scenes from --data, preset paper, its protocol"
        " and recipe printed, unless other options say otherwise.",
    )  # fmt: skip
    parser.add_argument("--preset", help=PRESETS_HELP.format("tiny"))
    parser.add_argument("--protocol", help="Score under this metric protocol (default: the suite's).")
    parser.add_argument("--out", type=Path, metavar="DIR", help="Keep the results in this folder (default: out/SUITE).")
    parser.add_argument(
        "--method", type=names, metavar="A,B",
        help="Run these methods (see `methods`, or TOML files) in the suite's table (default: the rows').",
    )  # fmt: skip
    add_trust(parser)
    parser.add_argument("--rows", type=names, metavar="A,B", help="Run these rows of the suite (default: all).")
    add_recipe(parser)
    add_effects(parser, default=None)
    add_set(parser)
    add_scene_options(parser)
    add_device(parser, "Use N CPU threads (default: as many as there are cores; with --engine ray, 1 for each cell).")
    add_engine(parser)
    parser.add_argument(
        "--keep-views",
        type=views_kept,
        metavar="N|all",
        help="Keep pictures of N test views with each result (default: as many as fit 128 MiB, uncompressed).",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="List the cells with their expected time and memory; run nothing."
    )
    parser.add_argument(
        "--difference",
        type=differences,
        default={},
        metavar="COLUMN=SIZE,...",
        help="With --dry-run, say how many scenes or seeds resolve this difference, such as albedo/psnr=0.3.",
    )
    parser.add_argument("--json", action="store_true", help="Print events instead of tables, one JSON object a line.")
    add_verbose(parser)


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where cells run, and which of them."""
    parser.add_argument(
        "--engine", choices=ENGINES,
        help="Run the cells in this process, in a pool of processes, or on a Ray cluster (default: inprocess).",
    )  # fmt: skip
    parser.add_argument(
        "--workers", type=positive, metavar="N", help="Run N cells at a time in a pool that shares the threads."
    )
    parser.add_argument(
        "--ray-address", metavar="HOST:PORT", help="Use this Ray cluster (default: start one on this machine)."
    )
    parser.add_argument("--worker", type=part_of, help=argparse.SUPPRESS)
    parser.add_argument(
        "--shard", type=part_of, default=(0, 1), metavar="I/N",
        help="Run part I of N, counted from 0. The parts' stores merge by copying their files together.",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Run or continue a suite; returns the exit code."""
    if not options.json:
        return _run(options)
    from .events import emit, emit_error

    try:
        code = _run(options)
    except ExplainedError as error:
        emit_error(error)
        raise
    emit("end", exit_code=code)
    return code


def _run(options: argparse.Namespace) -> int:
    if options.list:
        return _list(options)
    if options.suite is None:
        raise UsageError("no suite was named", "", "See them all:  radiogs-bench run --list")
    chosen = suite_of(options.suite)
    options.preset = options.preset or ("paper" if options.as_published else "tiny")
    if options.as_published:
        from ..suites.data_sets import as_published

        chosen = as_published(chosen)
    chosen, remarks = with_overrides(chosen, options)
    engine = choose(options.engine, options.workers, options.ray_address, options.threads)
    if options.dry_run and not options.scenes:
        from .plan import plan_without_data

        if lines := plan_without_data(chosen, options.seeds):
            say_remarks(lines, options.json)
            return 0
    folder = options.out or Path("out") / chosen.name

    from ..store.folder import Store

    request, device = request_from_options(options, chosen)
    store = Store(folder)
    if options.worker is not None:
        return run_as_worker(request, store, device, options)
    say_remarks([*remarks, *repairs_of(request.scenes)], options.json)
    if options.dry_run:
        from .plan import show_request

        show_request(request, store, engine, options.json, options.difference)
        return 0
    return run_and_report(request, store, device, engine, options)


def _list(options: argparse.Namespace) -> int:
    from ..suites.registry import SUITES

    suites = [suite_of(options.suite)] if options.suite else list(SUITES.values())
    if options.json:
        from .events import emit_suite

        for each in suites:
            emit_suite(each)
    elif options.suite:
        for line in describe(suites[0]):
            say(line)
    else:
        width = max(len(each.name) for each in suites)
        for each in suites:
            say(f"{each.name:{width}}  {each.title}")
        say("Rows, columns and scenes of one:  radiogs-bench run SUITE --list")
    return 0


def describe(suite: "Suite") -> list[str]:
    """Describe a suite in a few lines: title, rows, columns, scenes, where to find them, protocol, recipe."""
    return [
        f"{suite.name}: {suite.title} ({len(suite.rows)} rows, {len(suite.columns)} metrics)",
        f"  rows: {', '.join(row.key for row in suite.rows)}",
        f"  columns: {', '.join(metric.key for metric in suite.columns)}",
        f"  scenes: {', '.join(suite.scenes)}",
        *([f"  download: {suite.download}"] if suite.download else []),
        *([f"  protocol: {suite.protocol}"] if suite.protocol != "default" else []),
        *([f"  recipe: {suite.recipe}, in rows that name no other"] if suite.recipe else []),
    ]


def with_overrides(suite: "Suite", options: argparse.Namespace) -> "tuple[Suite, list[str]]":
    """The suite with the methods and fields that the options set, and remarks on rows that are not changed."""
    from ..suites.suite import of_methods, with_field, with_recipe, with_rows, with_settings

    remarks: list[str] = []
    if options.method:
        suite = of_methods(suite, options.method)
    if options.rows:
        suite = with_rows(suite, options.rows)
    if options.recipe:
        suite, remarks = with_recipe(suite, options.recipe)
    if options.effects not in (None, "all"):
        mark = options.effects if isinstance(options.effects, str) else "+".join(options.effects) or "none"
        suite = with_field(suite, "effects", options.effects, mark)
    if settings := settings_from(options):
        suite, kept = with_settings(suite, settings, options.preset)
        remarks += kept
    return suite, remarks


def request_from_options(options: argparse.Namespace, suite: "Suite") -> "tuple[Request, torch.device]":
    """The request that the options describe. Raises UsageError or DataError before anything is run."""
    from ..methods import FoundMethods
    from ..runs.sweep import Request
    from ..scoring.metrics.protocols import protocol
    from ..suites.scenes import load_scenes, own_scenes, place_of

    device = chosen_device(options, planned=options.dry_run)
    rules = protocol(options.protocol or suite.protocol).name
    given = options.scenes or own_scenes(suite)
    opened = scene_options(options)
    scenes = load_scenes(given, opened)
    places = dict(zip(scenes, map(place_of, given), strict=True))
    request = Request(
        suite,
        scenes,
        options.seeds,
        options.preset,
        rules,
        options.device,
        options.shard,
        places,
        FoundMethods(),
        opened,
        options.arguments,
        dict(options.settings),
    )
    request.cells()  # a method or preset that is not there shows now
    return request, device


def repairs_of(scenes: Mapping[str, "Scene"]) -> list[str]:
    """Messages on what was repaired or assumed in the scenes' files."""
    return [f"{name}: {repair}" for name, scene in scenes.items() for repair in scene.repairs]


def say_remarks(remarks: Sequence[str], as_json: bool) -> None:
    """Print remarks as lines, or as events."""
    from .events import emit

    for line in remarks:
        if as_json:
            emit("message", text=line)
        else:
            say(line)


def run_and_report(
    request: "Request", store: "Store", device: "torch.device", engine: "Engine", options: argparse.Namespace
) -> int:
    """Run the missing cells; write and print the reports. Returns the exit code.

    Raises NumericalFailure where suite ``stability`` finds errors beyond their tolerances, or ``hard-training`` changes
    of metrics beyond theirs.
    """
    from ..runs.engines.run import run_request
    from ..runs.interruption import Interruption
    from ..runs.progress import SweepProgress, progress_for_stderr
    from ..runs.scene_checksum import checksum_now
    from ..runs.stages import Bench
    from ..runs.sweep import steps_to_take
    from ..suites.experiment import STABILITY
    from ..suites.own import HARD_TRAINING
    from .events import EventProgress, emit
    from .growing import growing

    store.remove_leavings()
    fetch_weights_of(request, options.json)
    manifest = write_manifest(request, store)
    cells = request.own_cells()
    unfinished = [cell for _, cell in cells if store.result(cell.key) is None]
    shown = EventProgress(store, [ref for ref, _ in cells]) if options.json else progress_for_stderr()
    titles = {stage.title for _, cell in cells for stage in cell.stages}
    bars = SweepProgress(shown, titles, steps_to_take(store, unfinished))
    with growing(request, store, bars, options.json) as progress, Interruption() as interruption:
        bench = Bench(
            store, device, progress, interruption, request.method, checksum_now, kept_views=options.keep_views
        )
        ended = run_request(request, bench, engine)
        reported = report_failures(ended.failures)
        code = ended.code or reported
    manifest = final_manifest(request, store, manifest)
    from .showing import write, write_and_show  # not before there are results: errors need not wait for its tables

    if options.json:
        for path in write(store, manifest)[1]:
            emit("written", path=str(path))
    else:
        write_and_show(store, manifest)
        say_other_run(store, manifest)
    if request.suite.experiment == STABILITY:
        from ..runs.hard_cases import tolerances_kept

        say_remarks([tolerances_kept(store, [cell.key for _, cell in cells])], options.json)
    if request.suite.name == HARD_TRAINING.name:
        from ..results.invariance import invariance_kept

        say_remarks([invariance_kept(store, [ref for ref, _ in cells])], options.json)
    return code


def fetch_weights_of(request: "Request", as_json: bool) -> None:
    """Download what LPIPS lacks, if the suite has a column of it; results name the networks that had no weights."""
    from ..fetching.lpips_weights import fetch_missing
    from ..runs.progress import progress_for_stderr

    with progress_for_stderr() as progress:
        fetch_missing(request.lpips_networks(), lambda line: say_remarks([line], as_json), progress.advance)


def write_manifest(request: "Request", store: "Store") -> "Sweep":
    """Write the run's manifest, with the folder's rows that were scored from files and can be compared with it."""
    from ..runs.rows_from_files import with_rows_from_files
    from ..runs.sweep import changing_sweep
    from .aside import keep_reports

    with changing_sweep(store) as write_it:
        manifest = request.manifest([ref for ref, _ in request.cells()])
        manifest, outdated = with_rows_from_files(store, manifest, checksums_of(request))
        kept = keep_reports(store, manifest)
        write_it(manifest)
    if kept is not None:
        complain(f"the reports of the folder's last run, which was another one, are kept in {kept}")
    for name in outdated:
        complain(
            f"row '{name}' was scored from files by another version of the code and is left out."
            f" Score it again:  radiogs-bench score FOLDER --scene SCENE --into {store.folder} --row '{name}'"
        )
    return manifest


def final_manifest(request: "Request", store: "Store", manifest: "Sweep") -> "Sweep":
    """The run's manifest as it ends: rows scored from files may have been added while it ran."""
    from ..runs.rows_from_files import with_rows_from_files

    return with_rows_from_files(store, manifest, checksums_of(request))[0]


def checksums_of(request: "Request") -> dict[str, str]:
    """The scenes' checksums, by the names that the run has for them."""
    return {name: scene.checksum for name, scene in request.scenes.items()}


def say_other_run(store: "Store", manifest: "Sweep") -> None:
    """Print a remark if another run was started in the folder meanwhile: `report` rebuilds that one's reports."""
    from ..runs.sweep import read_sweep
    from ..store.seal import sealed

    try:
        last = read_sweep(store.folder)
    except DataError as error:
        complain(f"{error.what} {error.remedy}")
        return
    if last != sealed(manifest):
        say(
            f"Meanwhile suite '{last['suite']}' was started in {store.folder}: the reports above are of this run,"
            " `report` and `status` show that one."
        )


def run_as_worker(request: "Request", store: "Store", device: "torch.device", options: argparse.Namespace) -> int:
    """Run as one worker of several (``--worker``); returns its exit code."""
    from ..runs.engines.run import run_worker
    from ..runs.interruption import Interruption
    from ..runs.progress import progress_for_stderr
    from ..runs.scene_checksum import checksum_now
    from ..runs.stages import Bench

    with progress_for_stderr() as progress, Interruption() as interruption:
        bench = Bench(
            store, device, progress, interruption, request.method, checksum_now, kept_views=options.keep_views
        )
        return report_failures(run_worker(request, bench, options.worker[1]).failures)


def report_failures(failures: Sequence[ExplainedError]) -> int:
    """Print each failure once; returns the exit code of the whole run."""
    for message in dict.fromkeys(explain(failure) for failure in failures):
        complain(message)
    return worst_exit_code(failures)
