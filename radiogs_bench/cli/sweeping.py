"""Runs a suite from the command line: makes the request, shows progress, failures and reports."""

import argparse
from collections.abc import Mapping, Sequence
from functools import cache

import torch

from radiogs_core.errors import DataError, ExplainedError
from radiogs_core.kernels.runtime import workers
from radiogs_core.scene.scene import Scene

from ..errors import explain, worst_exit_code
from ..methods import method
from ..runs.engines.choice import Engine
from ..runs.engines.run import CPU, bring_to_end, work_along
from ..runs.interruption import Interruption
from ..runs.progress import SweepProgress, progress_for_stderr
from ..runs.rows_from_files import with_rows_from_files
from ..runs.scene_digest import checksum_now
from ..runs.stages import Bench
from ..runs.sweep import Request, Sweep, changing_sweep, read_sweep, steps_to_take
from ..scoring.metrics import protocol
from ..store.folder import Store
from ..store.seal import sealed
from ..suites.scenes import load_scenes, own_scenes, place_of
from ..suites.suite import Suite
from .device import chosen_device
from .earlier import keep_reports
from .events import EventProgress, emit
from .options import scene_options
from .reporter import complain, say


def wanted(options: argparse.Namespace, suite: Suite) -> tuple[Request, torch.device]:
    """The request from the options. Raises UsageError or DataError before anything is run."""
    device = chosen_device(options)
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
        cache(method),
        opened,
        options.arguments,
    )
    request.cells()  # a method or preset that is not there shows now
    return request, device


def say_repairs(scenes: Mapping[str, Scene], as_json: bool) -> None:
    """Print what was set right, or assumed, as scenes were read: lines for people, or events."""
    for name, scene in scenes.items():
        for repair in scene.repairs:
            line = f"{name}: {repair}"
            if as_json:
                emit("message", text=line)
            else:
                say(line)


def show_request(request: Request, store: Store, engine: Engine, as_json: bool) -> int:
    """Print the cells and estimates of their time and memory."""
    from .planning import emit_plan, show_plan

    if as_json:
        emit_plan(request, store)
    else:
        show_plan(request, store, *engine.cells_and_threads(workers(CPU)))
    return 0


def run_request(
    request: Request, store: Store, device: torch.device, engine: Engine, options: argparse.Namespace
) -> int:
    """Run the missing cells; write and print the reports. Returns the exit code."""
    manifest = write_manifest(request, store)
    cells = request.own_cells()
    unfinished = [cell for _, cell in cells if store.result(cell.key) is None]
    shown = EventProgress(store, [place for place, _ in cells]) if options.json else progress_for_stderr()
    titles = {stage.title for _, cell in cells for stage in cell.stages}
    bars = SweepProgress(shown, titles, steps_to_take(store, unfinished))
    with bars as progress, Interruption() as interruption:
        ended = bring_to_end(
            request,
            Bench(store, device, progress, interruption, request.method, checksum_now, kept_views=options.keep_views),
            engine,
            options.arguments,
        )
        reported = report_failures(ended.failures)
        code = ended.code or reported
    manifest = entered_meanwhile(request, store, manifest)
    from .showing import write, write_and_show  # its tables take a second to import: errors need not wait for it

    if options.json:
        for path in write(store, manifest)[1]:
            emit("written", path=str(path))
    else:
        write_and_show(store, manifest)
        say_other_run(store, manifest)
    return code


def write_manifest(request: Request, store: Store) -> Sweep:
    """Write what is asked for, with the rows of the folder that were scored from files and can be compared with it."""
    with changing_sweep(store) as write_it:
        manifest = request.manifest([place for place, _ in request.cells()])
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


def entered_meanwhile(request: Request, store: Store, manifest: Sweep) -> Sweep:
    """The run's manifest as it ends: rows scored from files may have been added while it ran."""
    return with_rows_from_files(store, manifest, checksums_of(request))[0]


def checksums_of(request: Request) -> dict[str, str]:
    """The scenes' checksums, by the names that the run has for them."""
    return {name: scene.checksum for name, scene in request.scenes.items()}


def say_other_run(store: Store, manifest: Sweep) -> None:
    """Say so where another run was started in the folder meanwhile: what `report` rebuilds is that one's."""
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


def work_along_with(request: Request, store: Store, device: torch.device, options: argparse.Namespace) -> int:
    """Run as one worker of several (``--worker``); returns its exit code."""
    with progress_for_stderr() as progress, Interruption() as interruption:
        bench = Bench(
            store, device, progress, interruption, request.method, checksum_now, kept_views=options.keep_views
        )
        return report_failures(work_along(request, bench, *options.worker).failures)


def report_failures(failures: Sequence[ExplainedError]) -> int:
    """Explain each failure once; returns the exit code of the whole run."""
    for message in dict.fromkeys(explain(failure) for failure in failures):
        complain(message)
    return worst_exit_code(failures)
