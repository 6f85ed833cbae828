"""``radiogs-bench score FOLDER --into OUT``: what anybody's files score, as a row of a finished run."""

import argparse
from pathlib import Path

from radiogs_core.errors import UsageError

from .options import scene_options

GIVEN = ("row", "seed", "force")
"""Options that say which row, and mean nothing without ``--into``."""

PLAIN_SCORE = ("json", "out")
"""Options of a score by itself."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a row in a run."""
    group = parser.add_argument_group(
        "into a finished run", "The files are scored as the run is, and become a row of its tables, figures and page."
    )
    group.add_argument(
        "--into", type=Path, metavar="OUT", help="folder of the run; --scene has to be one of its scenes"
    )
    group.add_argument("--row", metavar="NAME", help="the row's name in tables")
    group.add_argument("--seed", type=int, metavar="N", help="the run's seed that it is compared with (default: 0)")
    group.add_argument(
        "--force", action="store_true", default=None, help="replace the row's cell of this scene and seed"
    )


def is_asked(options: argparse.Namespace) -> bool:
    """Whether a row of a run is meant. Raises UsageError for options that do not go together."""
    if options.into is None:
        if alone := [name for name in GIVEN if getattr(options, name) is not None]:
            raise UsageError(f"--{alone[0]} is of a row in a run", "", "Name the run's folder:  --into OUT")
        return False
    if options.row is None:
        raise UsageError("the row has no name", "It stands in the run's tables.", "Add --row NAME")
    if options.scene is None or options.code == "stanford-orb":
        raise UsageError(
            "no scene was named",
            "A row is scored against the ground truth of one of the run's scenes, view by view.",
            "Add --scene PATH (pairs of files, as Stanford-ORB's, name their own targets and cannot be a row).",
        )
    if given := [name for name in PLAIN_SCORE if getattr(options, name)]:
        raise UsageError(
            f"--{given[0]} does not go with --into",
            "The run's reports and `export` hold what was scored.",
            f"Leave --{given[0]} out, or score the folder by itself.",
        )
    return True


def score_into(options: argparse.Namespace) -> int:
    """Score the folder, enter the row, and rebuild and print the run's reports."""
    from radiogs_baselines.outputs import read_predictions
    from radiogs_datasets import load_scene

    from ..runs.progress import progress_for_stderr
    from ..runs.rows_from_files import row_key
    from ..runs.scene_digest import checksum_now
    from ..runs.scored_row import NewRow, add_row, require_room, scene_in_run
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .reporter import say
    from .showing import write_and_show

    store, sweep = Store(options.into), read_sweep(options.into)
    row = NewRow(options.row, options.seed or 0, bool(options.force))
    row_key(row.name)  # a name that cannot be one shows before anything is read
    require_same_protocol(options, sweep["protocol"])
    scene = load_scene(options.scene, options=scene_options(options))
    require_room(store, sweep, row, scene_in_run(store, sweep, scene))
    predictions = read_predictions(options.predictions, scene, options.code)
    with progress_for_stderr() as progress:
        sweep = add_row(
            store, row, predictions, scene, checksum_now, lambda done, total: progress.advance("scoring", done, total)
        )
    for heading in ("remarks", "absent", "missing", "ignored"):
        for line in getattr(predictions, heading):
            say(f"{heading.removesuffix('s')}: {line}")
    write_and_show(store, sweep)
    return 0


def require_same_protocol(options: argparse.Namespace, of_run: str) -> None:
    """Raise UsageError where another protocol is asked for than the run's."""
    if options.protocol not in (None, of_run):
        raise UsageError(
            f"{options.into} was scored under protocol '{of_run}', not '{options.protocol}'",
            "Metrics of two protocols cannot stand in one table.",
            "Leave --protocol out; or run the suite under the other protocol, into another folder.",
        )
