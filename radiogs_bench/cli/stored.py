"""``radiogs-bench verify``, ``report``, ``gate``: damage of a run, its reports, and comparison with a baseline."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from radiogs_core.errors import DataError, UsageError, unknown

from ..errors import exit_code
from .options import add_verbose, declare, names

if TYPE_CHECKING:
    from .options import Commands

REGRESSION = 1


def add_to(commands: "Commands") -> None:
    """Declare ``verify`` and ``report``."""
    _declare(commands, "verify", "Check every stored file of a folder, and change none.", verify)
    reporting = _declare(commands, "report", "Rebuild tables, figures and the page from stored results.", report)
    reporting.add_argument(
        "--self-contained",
        action="store_true",
        help="Write report.html as a single file. It has fewer views, then smaller ones, where pictures take more than"
        " 20 MiB.",
    )
    reporting.add_argument(
        "--scenes",
        type=names,
        default=[],
        metavar="A,B",
        help="Report on these of its scenes alone (default: all).",
    )
    reporting.add_argument(
        "--no-pictures", dest="pictures", action="store_false",
        help="Leave out figures, images and surfels: tables and page are there within seconds.",
    )  # fmt: skip
    reporting.add_argument(
        "--beside", type=Path, metavar="OTHER",
        help="Compare the run with the one in this folder, cell by cell: on the page, in tables/beside.* and here.",
    )  # fmt: skip
    reporting.add_argument(
        "--style", choices=["paper"],
        help="Write OUT/paper.tex alone: the table as a paper prints it, without differences and remarks.",
    )  # fmt: skip
    reporting.add_argument(
        "--columns", type=names, default=[], metavar="A,B",
        help="With --style, print these metrics, such as nvs/psnr, in this order (default: all that have a value).",
    )  # fmt: skip


def _declare(
    commands: "Commands", name: str, purpose: str, command: Callable[[argparse.Namespace], int]
) -> argparse.ArgumentParser:
    parser = declare(commands, name, purpose, f"{name} out/ablations")
    parser.set_defaults(command=command)
    parser.add_argument("out", type=Path, metavar="OUT", help="Read the results in this folder.")
    add_verbose(parser)
    return parser


def verify(options: argparse.Namespace) -> int:
    """Print every damaged file, and what a rerun would take; returns 3 if there is any."""
    from ..results.verify import verify as look
    from ..runs.progress import working
    from ..store.folder import Store
    from .reporter import say, say_aside

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
    from .showing import Shown, write_and_show

    if options.style is not None:
        return report_for_paper(options)
    if options.columns:
        raise UsageError("--columns goes with --style paper", "", "Leave it out; tables of a run have all columns.")
    shown = Shown(options.self_contained, options.scenes, options.pictures, options.beside)
    write_and_show(Store(options.out), read_sweep(options.out), shown)
    return 0


def report_for_paper(options: argparse.Namespace) -> int:
    """Write the suite's table as a paper prints it, from the summary of the last report."""
    from radiogs_reports.summary import read_summary
    from radiogs_reports.tables.suite import suite_table
    from radiogs_reports.write.camera_ready import camera_ready_document

    from ..results.reports import damage_explained
    from ..runs.sweep import read_sweep
    from ..store.atomic import explained, write_atomically
    from .reporter import say

    if options.scenes:
        raise UsageError(
            "--scenes does not go with --style", "", f"First:  radiogs-bench report {options.out} --scenes A,B"
        )
    read_sweep(options.out)  # says what to do where there is no run
    with damage_explained():
        summary = read_summary(options.out)
    known = [column.key for column in suite_table(summary).columns]
    for key in options.columns:
        if key not in known:
            raise unknown("column", key, known, of=f"suite '{summary['suite']}'")
    path: Path = options.out / "paper.tex"
    with explained(options.out):
        write_atomically(path, camera_ready_document(summary, options.columns).encode())
    say(f"{path}: its table environment needs booktabs and graphicx; pdflatex compiles the whole")
    return 0


def add_gate(commands: "Commands") -> None:
    """Declare ``gate``, which stands behind ``export`` in ``--help``."""
    parser = declare(
        commands, "gate", "Compare a run with a stored baseline; the exit code is 1 for a regression.",
        "gate out/gate --baseline baselines/gate.json",
    )  # fmt: skip
    parser.set_defaults(command=gate)
    parser.add_argument("out", type=Path, nargs="?", metavar="OUT", help="Compare the run in OUT.")
    parser.add_argument(
        "--baseline", type=Path, required=True, metavar="FILE", help="Compare with the baseline in FILE."
    )
    parser.add_argument("--update", action="store_true", help="Make the run the new baseline.")
    parser.add_argument(
        "--rerun", type=Path, action="append", default=[], metavar="OTHER",
        help="With --update, measure how far a rerun differs: OTHER has the same run with another --threads. This"
        " option may be repeated.",
    )  # fmt: skip
    parser.add_argument(
        "--power", action="store_true",
        help="Say which loss of each metric a gate with this baseline finds with 80 %% probability; compare nothing.",
    )  # fmt: skip
    parser.add_argument(
        "--accept-changes", action="store_true",
        help="Let a run pass whose training computes something else, as long as nothing is worse.",
    )  # fmt: skip
    parser.add_argument(
        "--slow-fails", action="store_true",
        help="Let a training fail that takes 1.3 times the baseline's time on its machine.",
    )  # fmt: skip
    add_verbose(parser)


def gate(options: argparse.Namespace) -> int:
    """Print every change from the baseline; the exit code is 1 if any is a regression."""
    from ..results.baseline import baseline_of, read_baseline
    from ..results.gate import compare, power_lines
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from ..store.seal import write_sealed
    from .reporter import say, say_aside

    _require_gate_options(options)
    if options.power:
        for line in power_lines(read_baseline(options.baseline)):
            say(line)
        return 0
    store, sweep = Store(options.out), read_sweep(options.out)
    if options.update:
        reruns = [(Store(folder), read_sweep(folder)) for folder in options.rerun]
        made = baseline_of(store, sweep, reruns)
        write_sealed(options.baseline, made)
        known = "" if reruns else "; without --rerun it does not know how far a rerun differs"
        say(f"{options.baseline}: {len(made['cells'])} cells{known}")
        return 0
    changes = compare(store, sweep, read_baseline(options.baseline), options.slow_fails)
    for each in changes:
        say(f"{each.severity}: {each.cell}: {each.what}")
    say_aside(store)
    regressions, changed = (sum(each.severity == kind for each in changes) for kind in ("regression", "changed"))
    say(f"{len(sweep['cells'])} cells: {_ended(regressions, changed, options.accept_changes)}")
    return REGRESSION if regressions or (changed and not options.accept_changes) else 0


def _require_gate_options(options: argparse.Namespace) -> None:
    if options.out is None and not options.power:
        raise UsageError("no run was named", "", "Name its folder:  radiogs-bench gate OUT --baseline FILE")
    if options.rerun and not options.update:
        raise UsageError(
            "--rerun is for making a baseline",
            "A baseline keeps how far a rerun differs; a comparison reads it from there.",
            "Add --update, or leave --rerun out.",
        )


def _ended(regressions: int, changed: int, accepted: bool) -> str:
    """How the comparison ended, in words."""
    if not regressions and not changed:
        return "no worse than the baseline, and computed alike"
    said = [f"{regressions} regressions"] * bool(regressions)
    if changed:
        said.append(f"{changed} changes of what is computed" + (", accepted" if accepted else ""))
    ended = " and ".join(said)
    if accepted or not changed:
        return ended
    return f"{ended}. If they are intended, make the baseline again with --update, or pass --accept-changes"
