"""``radiogs-bench gate``: compare a run with a stored baseline."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .options import add_verbose

if TYPE_CHECKING:
    from .options import Commands

REGRESSION = 1


def add_to(commands: "Commands") -> None:
    """Declare the command."""
    parser = commands.add_parser("gate", help="compare a run with a stored baseline", allow_abbrev=False)
    parser.set_defaults(command=gate)
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of the run")
    parser.add_argument("--baseline", type=Path, required=True, metavar="FILE")
    parser.add_argument("--update", action="store_true", help="make the run the new baseline")
    add_verbose(parser)


def gate(options: argparse.Namespace) -> int:
    """Print every change from the baseline; the exit code is 1 if any is a regression."""
    from ..results.baseline import baseline_of, read_baseline
    from ..results.gate import compare
    from ..runs.sweep import read_sweep
    from ..store.atomic import write_atomically
    from ..store.folder import Store
    from ..store.seal import sealed, strict_json
    from .aside import say_aside
    from .reporter import say

    store, sweep = Store(options.out), read_sweep(options.out)
    if options.update:
        write_atomically(options.baseline, strict_json(sealed(baseline_of(store, sweep))))
        say(f"{options.baseline}: {len(sweep['cells'])} cells")
        return 0
    changes = compare(store, sweep, read_baseline(options.baseline))
    for each in changes:
        say(f"{each.severity}: {each.cell}: {each.what}")
    say_aside(store)
    regressions = sum(each.severity == "regression" for each in changes)
    cells = len(sweep["cells"])
    say(f"{cells} cells: " + (f"{regressions} regressions" if regressions else "as in the baseline"))
    return REGRESSION if regressions else 0
