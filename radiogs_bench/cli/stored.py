"""``radiogs-bench verify``, ``report``, ``export``: a folder's damage, reports, metrics or model."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import DataError

from ..errors import exit_code
from . import layout, mesh, splats
from .options import add_verbose

if TYPE_CHECKING:
    from .options import Commands


TABLES = ("csv", "json", "parquet")
LOGS = ("tensorboard", "wandb")
"""The course of training, for a logger."""


def add_to(commands: "Commands") -> None:
    """Declare the commands."""
    _declare(commands, "verify", "check every stored file of a folder, and change none", verify)
    reporting = _declare(commands, "report", "rebuild tables and figures from stored results", report)
    reporting.add_argument(
        "--self-contained",
        action="store_true",
        help="report.html as a single file: of pictures above 20 MiB it has fewer views, then smaller ones",
    )
    exporting = _declare(
        commands, "export", "a run's metrics as one table; a trained model as a mesh or images", export
    )
    exporting.add_argument(
        "--to",
        choices=(*TABLES, *LOGS, *splats.FORMS),
        default="csv",
        help="metrics; their course; surfels (default: csv)",
    )
    exporting.add_argument(
        "--file",
        type=Path,
        help="(default: OUT/export.csv and so on, OUT/tensorboard, OUT/wandb, OUT/3dgs.ply, OUT/mesh.ply, OUT/CODE)",
    )
    exporting.add_argument(
        "--row", metavar="ROW", help="of a run: the row whose surfels are written (default: the first)"
    )
    mesh.add_options(exporting)
    layout.add_options(exporting)


def _declare(
    commands: "Commands", name: str, purpose: str, command: Callable[[argparse.Namespace], int]
) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=purpose, allow_abbrev=False)
    parser.set_defaults(command=command)
    parser.add_argument("out", type=Path, metavar="OUT")
    add_verbose(parser)
    return parser


def verify(options: argparse.Namespace) -> int:
    """Print every file that is not as it was stored, and what a rerun would take; 3 if there is any."""
    from ..results.verify import verify as look
    from ..runs.progress import working
    from ..store.folder import Store
    from .aside import say_aside
    from .reporter import say

    with working(f"reading {options.out}"):
        found = look(options.out)
    for each in found.findings:
        say(f"{each.path}: {each.what}")
    say(f"{found.whole} files are as they were stored, {len(found.findings)} are not")
    if found.others:
        say(f"{found.others} files of other versions were left alone")
    say_aside(Store(options.out))
    rerun = found.rerun
    if rerun is not None and rerun.cells:
        time = (
            "as nothing like it has finished, its time is not known"
            if rerun.seconds is None
            else (f"about {rerun.seconds:.0f} s, as those that are there took")
        )
        say(f"The same `run` would finish {rerun.cells} cells and train {rerun.stages} stages for them: {time}.")
    return exit_code(DataError("")) if found.findings else 0


def report(options: argparse.Namespace) -> int:
    """Rebuild tables and figures from the stored results."""
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .showing import write_and_show

    write_and_show(Store(options.out), read_sweep(options.out), options.self_contained)
    return 0


def export(options: argparse.Namespace) -> int:
    """Write one table of every metric in the store, the course of its training, or a trained model in some form."""
    if options.mesh:
        return mesh.export_mesh(options)
    if options.layout_of is not None:
        return layout.export_layout(options)
    if options.to in splats.FORMS:
        return splats.export_splats(options)
    from ..export.records import export as write
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .aside import say_aside
    from .reporter import say

    sweep = read_sweep(options.out)  # says what to do where there is no run
    store = Store(options.out)
    if options.to == "tensorboard":
        from ..export.event_files import write_event_files

        folder = options.file or options.out / options.to
        say(f"{folder}: progress of {write_event_files(store, sweep, folder)} cells")
        return 0
    if options.to == "wandb":
        from ..export.wandb_runs import write_wandb_runs

        folder = options.file or options.out
        count = write_wandb_runs(store, sweep, folder)
        say(f"{folder / 'wandb'}: progress of {count} cells; send it:  wandb sync {folder / 'wandb'}/offline-run-*")
        return 0
    path = options.file or options.out / f"export.{options.to}"
    say(f"{path}: {write(store, path, options.to)} values")
    say_aside(store)
    return 0
