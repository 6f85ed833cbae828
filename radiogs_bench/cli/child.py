"""A part of a run, in a process of its own: the cells of a worker, or the reports of the complete scenes.

    python -m radiogs_bench.cli.child work|report < ORDER

The order is JSON from the process of the run, which started this one.
"""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path


def work(spec: dict[str, object], out: str, trusted: Sequence[str], count: int, verbose: bool) -> int:
    """Run cells as one of ``count`` workers (``runs.engines.run.Order``); returns the exit code."""
    from ..runs.engines.run import run_worker
    from ..runs.plan import resolve
    from ..runs.spec import RunSpec
    from ..store.folder import Store
    from ..trusted_methods import trusting
    from ..whole_runs import explained_code, working_bench
    from .reporter import complain

    with trusting(trusted):
        plan = resolve(RunSpec.from_plain(spec, "a worker's order"))
        with working_bench(plan, Store(Path(out))) as bench:
            return explained_code(run_worker(plan, bench, count).failures, complain)


def report(folder: str, scenes: Sequence[str], width: int | None) -> int:
    """Write the reports over some scenes without pictures, and print their table."""
    from ..results.reports import Shown
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .showing import write_and_show

    write_and_show(Store(Path(folder)), read_sweep(Path(folder)), Shown(scenes=scenes, pictures=False), width)
    return 0


def main() -> int:
    """Do the part that the command line names; returns the exit code of a command."""
    from .main import answered

    parts: dict[str, Callable[..., int]] = {"work": work, "report": report}
    part, order = parts[sys.argv[1]], json.load(sys.stdin)
    return answered(lambda: part(**order), bool(order.get("verbose")))


if __name__ == "__main__":
    sys.exit(main())
