"""``radiogs-bench verify``, ``report``, ``gate``: damage of a run, its reports, its comparison with a baseline."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from radiogs_core.errors import DataError, UsageError, unknown

from ..errors import exit_code
from .options import Names
from .reporter import say, say_aside
from .values import from_every_text

REGRESSION = 1


def verify(out: Path, /) -> int:
    """Check every stored file of a folder, and change none.

    Example:  radiogs-bench verify out/ablations

    :param out: Check the results in this folder.
    """
    from ..results.verify import verify as look
    from ..runs.progress import working
    from ..store.folder import Store

    with working(f"reading {out}"):
        found = look(out)
    for each in found.findings:
        say(f"{each.path}: {each.what}")
    say(f"{found.whole} files are as they were stored, {len(found.findings)} are not")
    if found.others:
        say(f"{found.others} files of other versions were left alone")
    say_aside(Store(out))
    if (rerun := found.rerun) is not None and rerun.cells:
        time = "as nothing like it has finished, its time is not known"
        if rerun.seconds is not None:
            time = f"about {rerun.seconds:.0f} s, as those that are there took"
        say(f"The same `run` would finish {rerun.cells} cells and train {rerun.stages} stages for them: {time}.")
    return exit_code(DataError("")) if found.findings else 0


def report(
    out: Path,
    /,
    *,
    pictures_beside: bool = False,
    scenes: Names = (),
    no_pictures: bool = False,
    beside: Path | None = None,
    style: Literal["paper"] | None = None,
    columns: Names = (),
) -> None:
    """Rebuild tables, figures and the page from stored results.

    Example:  radiogs-bench report out/ablations

    :param out: Read the results in this folder.
    :param pictures_beside: Keep all pictures of report.html in the folder report_files, as stored. Without this option
        the page is a single file of about 15 MB, with as many views as fit.
    :param scenes: Report on these of its scenes alone (default: all).
    :param no_pictures: Leave out figures, images and surfels: tables and page are there within seconds.
    :param beside: Compare the run with the one in this folder, cell by cell: on the page, in tables/beside.* and here.
    :param style: Write OUT/paper_table.tex to be input, and paper.tex around it, alone: the table as a paper prints it,
        without differences and remarks.
    :param columns: With --style, print these metrics, such as nvs/psnr, in this order (default: all that have a value).
    """
    from ..results.reports import Shown
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from .showing import write_and_show

    if style is not None and scenes:
        raise UsageError("--scenes does not go with --style", "", f"First:  radiogs-bench report {out} --scenes A,B")
    if style is None and columns:
        raise UsageError("--columns goes with --style paper", "", "Leave it out; tables of a run have all columns.")
    sweep = read_sweep(out)
    if style is not None:
        _report_for_paper(out, columns)
    else:
        write_and_show(Store(out), sweep, Shown(pictures_beside, scenes, not no_pictures, beside))


def _report_for_paper(out: Path, columns: Sequence[str]) -> None:
    """Write the suite's table as a paper prints it, from the summary of the last report."""
    from radiogs_reports.summary import read_summary
    from radiogs_reports.tables.suite import suite_table
    from radiogs_reports.write.camera_ready import camera_ready
    from radiogs_reports.write.latex import document

    from ..results.reports import damage_explained
    from ..store.atomic import explained, write_atomically

    with damage_explained():
        summary = read_summary(out)
    known = [column.key for column in suite_table(summary).columns]
    for key in columns:
        if key not in known:
            raise unknown("column", key, known, of=f"suite '{summary['suite']}'")
    table = camera_ready(summary, columns)
    with explained(out):
        write_atomically(out / "paper_table.tex", table.encode())
        write_atomically(out / "paper.tex", document(table).encode())
    say(f"{out / 'paper_table.tex'}: a table to input, with booktabs and graphicx; pdflatex compiles paper.tex")


@dataclass(frozen=True)
class Gating:
    """Options of a gate: work other than comparing, and changes that pass."""

    update: bool = False
    """Make the run the new baseline."""
    rerun: Annotated[tuple[Path, ...], from_every_text(Path)] = ()
    """With --update, measure how far a rerun differs: this folder has the same run with another --threads. This option
    may be repeated."""
    power: bool = False
    """Print the loss of each metric that a gate with this baseline finds in three of four runs; compare nothing."""
    accept_changes: bool = False
    """Let a run pass whose training computes something else, as long as nothing is worse."""
    slow_fails: bool = False
    """Let a training fail that takes 1.3 times the baseline's time on its machine."""


def gate(
    out: Path | None = None, /, *, baseline: Path, gating: Annotated[Gating, Parameter(name="*")] = Gating()
) -> int:
    """Compare a run with a stored baseline; the exit code is 1 for a regression.

    Example:  radiogs-bench gate out/gate --baseline baselines/gate.json

    :param out: Compare the run in this folder.
    :param baseline: Compare with the baseline in this file.
    """
    from ..results.baseline import baseline_of, read_baseline
    from ..results.gate import compare, power_lines
    from ..runs.sweep import read_sweep
    from ..store.folder import Store
    from ..store.seal import write_sealed

    if gating.rerun and not gating.update:
        raise UsageError(
            "--rerun is for making a baseline",
            "A baseline keeps how far a rerun differs; a comparison reads it from there.",
            "Add --update, or leave --rerun out.",
        )
    if gating.power:
        say(*power_lines(read_baseline(baseline)))
        return 0
    if out is None:
        raise UsageError("no run was named", "", "Name its folder:  radiogs-bench gate OUT --baseline FILE")
    store, sweep = Store(out), read_sweep(out)
    if gating.update:
        made = baseline_of(store, sweep, [(Store(folder), read_sweep(folder)) for folder in gating.rerun])
        write_sealed(baseline, made)
        known = "" if gating.rerun else "; without --rerun it does not know how far a rerun differs"
        say(f"{baseline}: {len(made['cells'])} cells{known}")
        return 0
    changes = compare(store, sweep, read_baseline(baseline), gating.slow_fails)
    for each in changes:
        say(f"{each.severity}: {each.cell}: {each.what}")
    say_aside(store)
    regressions, changed = (sum(each.severity == kind for each in changes) for kind in ("regression", "changed"))
    say(f"{len(sweep['cells'])} cells: {_ended(regressions, changed, gating.accept_changes)}")
    return REGRESSION if regressions or (changed and not gating.accept_changes) else 0


def _ended(regressions: int, changed: int, accepted: bool) -> str:
    """The outcome of the comparison in words."""
    if not regressions and not changed:
        return "no worse than the baseline, and computed alike"
    said = [f"{regressions} regressions"] * bool(regressions)
    if changed:
        said.append(f"{changed} changes of what is computed" + (", accepted" if accepted else ""))
    ended = " and ".join(said)
    if accepted or not changed:
        return ended
    return f"{ended}. If they are intended, make the baseline again with --update, or pass --accept-changes"
