"""``radiogs-bench run``: run a suite's cells, or continue them, then write and print its table.

The module is imported for ``--help``: what computes is imported by the functions that need it.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import ExplainedError, UsageError

from ..runs.engines.choice import ENGINES
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
    from ..runs.engines.choice import Engine
    from ..runs.plan import RunPlan
    from ..runs.spec import RunSpec
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
    from ..device import usable_cores, use
    from ..runs.engines.choice import choose
    from ..runs.plan import resolve, suite_asked
    from ..store.folder import Store

    spec = spec_from(options)
    engine = choose(options.engine, options.workers, options.ray_address, options.threads)
    if options.dry_run and not spec.scenes:
        from .plan import plan_without_data

        if lines := plan_without_data(suite_asked(spec)[0], spec.seeds):
            say_lines(lines, options.json)
            return 0
    use(spec.device, spec.threads, planned=options.dry_run)
    plan = resolve(spec)
    say_lines(plan.remarks, options.json)
    store = Store(options.out or Path("out") / plan.suite.name)
    if options.dry_run:
        from .plan import emit_plan, show_plan

        if options.json:
            emit_plan(plan, store, options.difference)
        else:
            show_plan(plan, store, *engine.cells_and_threads(usable_cores()), options.difference)
        return 0
    return _carried_out(plan, store, engine, options)


def spec_from(options: argparse.Namespace) -> "RunSpec":
    """The request that the options describe. Raises UsageError."""
    from ..runs.spec import RunSpec

    return RunSpec(
        suite=options.suite,
        methods=tuple(options.method or ()),
        rows=tuple(options.rows or ()),
        scenes=tuple(options.scenes or ()),
        scene_options=scene_options(options),
        seeds=options.seeds,
        preset=options.preset or "",
        settings=settings_from(options),
        recipe=options.recipe or "",
        effects="all" if options.effects is None else options.effects,
        protocol=options.protocol or "",
        as_published=options.as_published,
        device=options.device,
        threads=options.threads,
        shard=options.shard,
        keep_views=options.keep_views,
    )


def _carried_out(plan: "RunPlan", store: "Store", engine: "Engine", options: argparse.Namespace) -> int:
    """Run the missing cells, and write and print the reports. Returns the exit code.

    Raises NumericalFailure where suite ``stability`` or ``hard-training`` exceeds its tolerances.
    """
    from ..results.reports import verdicts
    from ..whole_runs import Audience, carry_out, other_run
    from .events import EventProgress, emit

    to = Audience(partial(say_line, as_json=options.json), complain, table=not options.json)
    if options.json:
        to = replace(to, progress=lambda store, cells: EventProgress(store, [ref for ref, _ in cells]))
    ended = carry_out(plan, store, engine, to, options.arguments)
    from .showing import write, write_and_show  # not before there are results: errors need not wait for its tables

    if options.json:
        for path in write(store, ended.manifest)[1]:
            emit("written", path=str(path))
    else:
        write_and_show(store, ended.manifest)
        if remark := other_run(store, ended.manifest):
            say(remark)
    say_lines(verdicts(plan, store), options.json)
    return ended.code


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


def say_lines(lines: Sequence[str], as_json: bool) -> None:
    """Print lines, or write them as events."""
    for line in lines:
        say_line(line, as_json)


def say_line(line: str, as_json: bool) -> None:
    """Print a line, or write it as an event."""
    from .events import emit

    if as_json:
        emit("message", text=line)
    else:
        say(line)
