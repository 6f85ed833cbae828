"""``radiogs-bench run``: run a suite's cells, then write and print its table."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import ExplainedError, UsageError

from ..runs.engines.choice import ENGINES, choose
from .options import add_effects, add_scene_options, add_verbose, names, part_of, positive, seeds, views_kept

if TYPE_CHECKING:
    from ..suites.suite import Suite
    from .options import Commands


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = commands.add_parser("run", help="run a suite, or continue it", allow_abbrev=False)
    parser.set_defaults(command=run)
    parser.add_argument("suite", nargs="?", metavar="SUITE", help="a name (see --list), or a TOML file")
    parser.add_argument("--list", action="store_true", help="list the suites, or the one that is named, and leave")
    parser.add_argument("--scenes", type=names, metavar="A,B", help="scene names or folders (default: the suite's)")
    parser.add_argument("--seeds", type=seeds, default=1, metavar="N", help="run seeds 0 to N-1 (default: 1)")
    parser.add_argument("--preset", default="tiny", help="budget: smoke, tiny, small, paper (default: tiny)")
    parser.add_argument("--protocol", help="metric protocol (default: the suite's, else default)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results (default: out/SUITE)")
    parser.add_argument(
        "--method", type=names, metavar="A,B", help="methods to run (see `methods`), or TOML files (default: the rows')"
    )
    add_effects(parser, default=None)
    add_scene_options(parser)
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu", help="(default: cpu)")
    parser.add_argument("--threads", type=positive, metavar="N", help="CPU threads (default: all cores; ray: 1 a cell)")
    parser.add_argument("--engine", choices=ENGINES, help="what runs the cells (default: inprocess)")
    parser.add_argument("--workers", type=positive, metavar="N", help="a pool: N cells at a time, sharing the threads")
    parser.add_argument("--ray-address", metavar="HOST:PORT", help="of a Ray cluster (default: one of this machine)")
    parser.add_argument("--worker", type=part_of, help=argparse.SUPPRESS)
    parser.add_argument(
        "--shard", type=part_of, default=(0, 1), metavar="I/N", help="run part I (from 0) of N; stores merge by copying"
    )
    parser.add_argument(
        "--keep-views",
        type=views_kept,
        metavar="N|all",
        help="keep pictures of N test views with each result (default: as many as fit 128 MiB, uncompressed)",
    )
    parser.add_argument("--dry-run", action="store_true", help="list the cells and what they will take, run nothing")
    parser.add_argument("--json", action="store_true", help="events instead of tables, one JSON object a line")
    add_verbose(parser)


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
    chosen = turned(chosen, options)
    engine = choose(options.engine, options.workers, options.ray_address, options.threads)
    folder = options.out or Path("out") / chosen.name

    from ..store.folder import Store
    from .sweeping import run_request, say_repairs, show_request, wanted, work_along_with

    request, device = wanted(options, chosen)
    store = Store(folder)
    if options.worker is not None:
        return work_along_with(request, store, device, options)
    say_repairs(request.scenes, options.json)
    if options.dry_run:
        return show_request(request, store, engine, options.json)
    return run_request(request, store, device, engine, options)


def turned(suite: "Suite", options: argparse.Namespace) -> "Suite":
    """The suite with the methods and variant fields that the options set."""
    from ..suites.suite import of_methods, with_field

    if options.method:
        suite = of_methods(suite, options.method)
    if options.effects not in (None, "all"):
        mark = options.effects if isinstance(options.effects, str) else "+".join(options.effects) or "none"
        suite = with_field(suite, "effects", options.effects, mark)
    return suite


def _list(options: argparse.Namespace) -> int:
    from ..suites.registry import SUITES
    from .planning import describe, emit_suite
    from .reporter import say

    for each in [suite_of(options.suite)] if options.suite else SUITES.values():
        if options.json:
            emit_suite(each)
        else:
            for line in describe(each):
                say(line)
    return 0


def suite_of(name_or_file: str) -> "Suite":
    """A suite from the package, or from a file."""
    if name_or_file.endswith(".toml"):
        from ..suites.toml_file import read_suite

        return read_suite(Path(name_or_file))
    from ..suites.registry import suite

    return suite(name_or_file)
