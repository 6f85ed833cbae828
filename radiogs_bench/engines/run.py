"""The steps of a run: what is asked for, what is there already, running the rest, showing the table."""

import argparse
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch

from radiogs.budget import budget
from radiogs.stages import Initialisation, InverseRendering
from radiogs_core.errors import DataError, ExplainedError, UsageError
from radiogs_core.kernels.runtime import use_threads, workers
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.layouts.inspection import shown

from ..cli.events import EventProgress, emit
from ..cli.on_cluster import THREADS, place_of, run_there
from ..cli.reporter import complain
from ..errors import DONE, EXIT_CODES, explain, worst_exit_code
from ..experiments.method import Method
from ..experiments.registry import EXPERIMENTS
from ..metrics import protocol
from ..metrics.weights import complaint
from ..store.folder import Store
from ..suites.cell import Cell
from ..suites.suite import Suite
from ..suites.sweep import Place, Request, label, steps_to_take, write_sweep
from ..training.interruption import Interruption
from ..training.preflight import read_everything
from ..training.progress import Progress, SweepProgress, progress_for_stderr
from ..training.stages import INITIALISE, INVERT, Bench
from ..training.warm_up import compile_kernels
from .choice import Engine
from .delegate import Recipe
from .in_process import Task, run_cells
from .pool import run_pool, worker_commands

CPU = torch.device("cpu")

COMPILED_ON = "convex"

RADIOGS = Method(Initialisation, InverseRendering)


def plan(options: argparse.Namespace, suite: Suite) -> tuple[Request, torch.device]:
    """What the options ask for. Raises UsageError or DataError before anything is run."""
    device = torch.device(options.device)
    if device.type == "cuda" and not torch.cuda.is_available():
        raise UsageError(
            "no CUDA device was found", "torch sees no GPU, or is a build without CUDA.", "Leave --device cuda out."
        )
    use_threads(options.threads or len(os.sched_getaffinity(0)))
    rules = protocol(options.protocol or suite.protocol).name
    preset = budget(options.preset)
    scenes = load_scenes(options.scenes or own_scenes(suite))
    return Request(suite, scenes, options.seeds, preset, rules, options.device, options.shard), device


def own_scenes(suite: Suite) -> Sequence[str]:
    """The scenes of a suite. Raises DataError where they have to be downloaded first, or lie elsewhere."""
    absent = [name for name in suite.scenes if not Path(name).is_dir()] if suite.download else []
    if absent:
        raise DataError(
            f"suite '{suite.name}' needs scenes that are not here: {shown(absent)}",
            f"They do not come with the package. {suite.download}",
            "Run this in the folder that holds them, or say where they are:  radiogs-bench run"
            f" {suite.name} --scenes PATH/{suite.scenes[0]},PATH/{suite.scenes[-1]}",
        )
    return suite.scenes


def load_scenes(wanted: Sequence[str]) -> dict[str, Scene]:
    """Scenes by their own names. Raises DataError for what is missing, UsageError where two bear one name."""
    scenes: dict[str, Scene] = {}
    for each in wanted:
        scene = load_scene(each)
        if scene.name in scenes:
            raise UsageError(
                f"two scenes are called '{scene.name}'",
                "Their rows in a table could not be told apart.",
                "Rename one of the folders, or run them into folders of their own with --out.",
            )
        scenes[scene.name] = scene
    return scenes


def cells_and_threads(engine: Engine) -> tuple[int, int]:
    """How many cells are run at a time on this machine, and on how many threads each."""
    threads = workers(CPU)
    together = (engine.workers or threads) if engine.name == "pool" else 1
    return together, max(1, threads // together)


def scene_places(request: Request, options: argparse.Namespace) -> dict[str, str]:
    """Where another process finds the request's scenes, by the names that they have in tables."""
    return dict(zip(request.scenes, map(place_of, options.scenes or request.suite.scenes), strict=True))


def bring_to_end(
    request: Request, store: Store, device: torch.device, engine: Engine, options: argparse.Namespace
) -> int:
    """Run what is missing, by whichever engine; write and show the reports. Returns the exit code."""
    write_sweep(store, request.manifest([place for place, _ in request.cells()]))
    cells = request.own_cells()
    unfinished = [cell for _, cell in cells if store.result(cell.key) is None]
    shown = EventProgress(store, [place for place, _ in cells]) if options.json else progress_for_stderr()
    bars = SweepProgress(shown, (INITIALISE, INVERT), steps_to_take(store, unfinished))
    with bars as progress, Interruption() as interruption:
        make_ready(request, unfinished, device, progress)
        tasks = [Task(cell, label(place)) for place, cell in cells]
        if engine.name == "pool" and unfinished:
            threads = workers(CPU)
            commands = worker_commands(options.arguments, engine.workers or threads, threads)
            look = partial(count_finished, store, cells, progress)
            codes = run_pool(commands, progress.say, look, interruption)
            interruption.check()
            # A worker that was killed costs time only, if the others have taken up its cells.
            whole = all(store.has_result(cell.key) for _, cell in cells)
            code = DONE if whole else worst_of(codes)
        elif engine.name == "ray" and unfinished:
            recipe = Recipe(RADIOGS, EXPERIMENTS[request.suite.experiment], load_scene, COMPILED_ON)
            threads = options.threads or THREADS
            places = scene_places(request, options)
            code = report_failures(
                run_there(tasks, recipe, places, threads, request.device, engine.address, store, progress, interruption)
            )
        else:
            code = report_failures(run_tasks(request, store, device, tasks, progress, interruption))
    from ..cli.showing import write, write_and_show  # its tables take a second to import: errors need not wait for it

    if options.json:
        for path in write(store)[1]:
            emit("written", path=str(path))
    else:
        write_and_show(store)
    return code


def work_along(request: Request, store: Store, device: torch.device, number: int, count: int) -> int:
    """What one of several workers does: the same cells, beginning elsewhere; returns its exit code.

    Cells that share stage 1 stay together, so that workers meet in the middle and not at once.
    """
    groups: dict[str, list[Task]] = {}
    for place, cell in request.own_cells():
        groups.setdefault(cell.initialisation_key, []).append(Task(cell, label(place)))
    ordered = list(groups.values())
    first = number * len(ordered) // count
    tasks = [task for group in (*ordered[first:], *ordered[:first]) for task in group]
    with progress_for_stderr() as progress, Interruption() as interruption:
        return report_failures(run_tasks(request, store, device, tasks, progress, interruption))


def run_tasks(
    request: Request,
    store: Store,
    device: torch.device,
    tasks: Sequence[Task],
    progress: Progress,
    interruption: Interruption,
) -> list[ExplainedError]:
    """Run cells in this process; returns the errors of those that failed."""
    bench = Bench(store, RADIOGS, device, progress, interruption)
    experiment = EXPERIMENTS[request.suite.experiment]
    return run_cells(
        tasks, lambda cell: experiment(bench, cell, request.scenes[cell.scene]), store, progress, interruption
    )


def count_finished(store: Store, cells: Sequence[tuple[Place, Cell]], progress: Progress) -> None:
    """How far workers have come, as the store shows it."""
    progress.advance("cells", sum(store.has_result(cell.key) for _, cell in cells), len(cells))


def make_ready(request: Request, unfinished: Sequence[Cell], device: torch.device, progress: Progress) -> None:
    """Find damaged files and compile the kernels now, not after an hour's training or within somebody's seconds."""
    scenes = [request.scenes[name] for name in dict.fromkeys(cell.scene for cell in unfinished)]
    for scene in scenes:
        read_everything(scene, partial(progress.advance, f"reading {scene.name}"))
    if scenes:
        if any(column.measure.startswith("lpips") for column in request.suite.columns):
            for rules in protocol(request.protocol).lpips:
                if complaint(rules.net):
                    progress.say(complaint(rules.net))
        progress.say("compiling kernels (kept for the next run)")
        # Of a scene that holds images: some experiments are run on scenes without.
        compile_kernels(RADIOGS, load_scene(COMPILED_ON), device, (cell.variant for cell in unfinished))


def worst_of(codes: Sequence[int]) -> int:
    """The exit code of a run with unfinished cells whose workers ended with these."""
    known = [code for _, code in EXIT_CODES]
    return min((code for code in codes if code in known), key=known.index, default=1)


def report_failures(failures: Sequence[ExplainedError]) -> int:
    """Explain each failure once; returns the exit code of the whole run."""
    for message in dict.fromkeys(explain(failure) for failure in failures):
        complain(message)
    return worst_exit_code(failures)
