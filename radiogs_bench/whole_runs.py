"""Whole runs: a suite's cells, their reports, tables and the gate, for the shell and for Python alike."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd
import torch

from radiogs_core.errors import DataError, ExplainedError
from radiogs_reports.summary import read_summary
from radiogs_reports.tables.model import PrintedCell
from radiogs_reports.tables.suite import suite_table

from .device import use
from .errors import CellFailed, explain, worst_exit_code
from .fetching.lpips_weights import fetch_missing
from .results.baseline import read_baseline
from .results.gate import compare
from .results.growing import growing
from .results.reports import keep_reports, verdicts, write
from .runs.engines.choice import Engine, choose
from .runs.engines.run import run_plan
from .runs.interruption import Interruption
from .runs.plan import Cells, RunPlan, resolve
from .runs.progress import Progress, SweepProgress, progress_for_stderr
from .runs.rows_from_files import with_rows_from_files
from .runs.scene_checksum import checksum_now
from .runs.spec import RunSpec
from .runs.stages import Bench
from .runs.sweep import Sweep, changing_sweep, read_sweep, steps_to_take
from .store.folder import Store
from .store.seal import sealed
from .trusted_methods import trusting

__all__ = ["RunSpec", "gate", "run", "table"]

Shown = Literal["value", "difference", "low", "high", "verdict", "paper"]


@dataclass(frozen=True)
class Audience:
    """Receives the messages and progress of a run."""

    say: Callable[[str], None]
    """Receives remarks and verdicts."""
    complain: Callable[[str], None]
    """Receives warnings, and the failures of cells."""
    progress: Callable[[Store, Cells], Progress] = lambda store, cells: progress_for_stderr()
    """Makes the display of steps and of the engine's messages."""
    table: bool = False
    """Whether the first table of several scenes is shown as soon as it is complete."""


def run(
    suite: str | RunSpec,
    out: str | Path | None = None,
    *,
    engine: str | None = None,
    workers: int | None = None,
    ray_address: str | None = None,
    trust: Sequence[str | Path] = (),
    say: Callable[[str], None] = lambda line: None,
    **options: Any,
) -> pd.DataFrame:
    """Run the cells of a suite that are not in ``out`` yet, write its reports, and return its table (see ``table``).

    ``suite`` is a suite's name or file, with ``options`` that are fields of ``RunSpec`` and of ``SceneOptions`` such as
    ``scenes=["corner"]``, ``seeds=2``, ``preset="smoke"`` or ``settings={"inverse_iterations": 600}``; or it is a whole
    ``RunSpec``. ``engine``, ``workers`` and ``ray_address`` tell where cells run, as the options of ``radiogs-bench
    run`` do. Methods' files that ``options`` or ``trust`` name may run their commands; a spec alone names none.
    ``say`` receives remarks and failures. Raises UsageError and DataError for what cannot be run, CellFailed where a
    cell failed (the other cells are kept), and NumericalFailure where suite ``stability`` or ``hard-training`` exceeds
    its tolerances.
    """
    spec = suite if isinstance(suite, RunSpec) else RunSpec.of(suite, **options)
    own = () if isinstance(suite, RunSpec) else spec.methods
    with trusting([*own, *map(str, trust)]):
        plan = resolve(spec)
        store = Store(Path("out") / plan.suite.name if out is None else Path(out))
        chosen = choose(engine, workers, ray_address, spec.threads)
        code, manifest = carry_out(plan, store, chosen, Audience(say, say))
        write(store, manifest)
        for line in verdicts(plan, store):
            say(line)
    if code:
        raise CellFailed(
            f"the run ended with exit code {code}", "Some of its cells failed; ``say`` is told why each did."
        )
    return table(store.folder)


def carry_out(
    plan: RunPlan, store: Store, engine: Engine, to: Audience, command: Sequence[str] = ()
) -> tuple[int, Sweep]:
    """Run the missing cells of a plan; returns the exit code and the manifest.

    ``command``: the arguments of the command line, if the run came from the shell.
    """
    store.remove_leavings()
    with progress_for_stderr() as progress:
        fetch_missing(plan.lpips_networks, to.say, progress.advance)
    manifest = write_manifest(plan, store, to, command)
    unfinished = [cell for _, cell in plan.own_cells if store.result(cell.key) is None]
    titles = {stage.title for _, cell in plan.own_cells for stage in cell.stages}
    bars = SweepProgress(to.progress(store, plan.own_cells), titles, steps_to_take(store, unfinished))
    with working_bench(plan, store, growing(plan, store, bars, to.table)) as bench:
        ended = run_plan(plan, bench, engine)
    code = ended.code or explained_code(ended.failures, to.complain)
    return code, with_rows_from_files(store, manifest, checksums_of(plan))[0]  # rows may have been added


@contextmanager
def working_bench(plan: RunPlan, store: Store, progress: Progress | None = None) -> Iterator[Bench]:
    """Where the cells of a plan run in this process: its device, its threads, and Ctrl-C as a request to stop."""
    device: torch.device = use(plan.spec.device, plan.spec.threads)
    with progress or progress_for_stderr() as shown, Interruption() as interruption:
        yield Bench(store, device, shown, interruption, plan.method, checksum_now, kept_views=plan.spec.keep_views)


def explained_code(failures: Sequence[ExplainedError], complain: Callable[[str], None]) -> int:
    """Tell each failure once; returns the exit code of the whole run."""
    for message in dict.fromkeys(explain(failure) for failure in failures):
        complain(message)
    return worst_exit_code(failures)


def write_manifest(plan: RunPlan, store: Store, to: Audience, command: Sequence[str]) -> Sweep:
    """Write the run's manifest, with the folder's rows that were scored from files and can be compared with it."""
    with changing_sweep(store) as write_it:
        manifest, outdated = with_rows_from_files(store, plan.manifest(command), checksums_of(plan))
        kept = keep_reports(store, manifest)
        write_it(manifest)
    if kept is not None:
        to.complain(f"the reports of the folder's last run, which was another one, are kept in {kept}")
    for name in outdated:
        to.complain(
            f"row '{name}' was scored from files by another version of the code and is left out."
            f" Score it again:  radiogs-bench score FOLDER --scene SCENE --into {store.folder} --row '{name}'"
        )
    return manifest


def checksums_of(plan: RunPlan) -> dict[str, str]:
    """The scenes' checksums, by the names that the run has for them."""
    return {name: scene.checksum for name, scene in plan.scenes.items()}


def other_run(store: Store, manifest: Sweep) -> str:
    """A remark if another run was started in the folder meanwhile: `report` would rebuild the other run's reports."""
    try:
        last = read_sweep(store.folder)
    except DataError as error:
        return f"{error.what} {error.remedy}"
    if last == sealed(manifest):
        return ""
    return (
        f"Meanwhile suite '{last['suite']}' was started in {store.folder}: the reports above are of this run,"
        " `report` and `status` show the other one."
    )


def table(folder: str | Path, what: Shown = "value") -> pd.DataFrame:
    """The table of the run in a folder, as ``run`` and ``report`` print it: a line per row, a column per metric.

    ``what``: ``value`` (means; ``attrs["caption"]`` of the frame says over what), ``difference`` to the reference row,
    ``low`` and ``high`` of its 95 % interval, ``verdict`` (better, worse, or none), or ``paper`` (the published value).
    Raises DataError if the folder has no table yet.
    """
    try:
        made = suite_table(read_summary(Path(folder)))
    except (OSError, ValueError) as error:
        raise DataError(
            f"no table in '{folder}'", str(error), f"Finish a run, or rebuild it:  radiogs-bench report {folder}"
        ) from error
    lines = {row.text: [_entry(cell, what) for cell in row.cells] for row in made.rows}
    frame = pd.DataFrame.from_dict(lines, orient="index", columns=[column.key for column in made.columns])
    frame.attrs["caption"] = made.caption
    return frame


def gate(folder: str | Path, baseline: str | Path, slow_fails: bool = False) -> pd.DataFrame:
    """Differences between the run in a folder and a baseline, one line each: ``severity``, ``cell``, ``what``.

    docs/reliability.md lists severities; the run is worse where one is ``regression``. Raises DataError for results or
    a baseline that cannot be compared.
    """
    path = Path(folder)
    changes = compare(Store(path), read_sweep(path), read_baseline(Path(baseline)), slow_fails)
    return pd.DataFrame(
        [(each.severity, each.cell, each.what) for each in changes], columns=["severity", "cell", "what"]
    )


def _entry(cell: PrintedCell, what: Shown) -> Any:
    if what == "value":
        return cell.value
    if what == "paper":
        return None if cell.published is None else cell.published.value
    if cell.difference is None:
        return None
    if what == "verdict":
        return cell.verdict
    return cell.difference.interval["mean" if what == "difference" else what]
