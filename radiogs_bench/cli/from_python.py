"""Whole commands from Python: ``run`` a suite, its ``table``, and the ``gate``.

They take the options of the command line by their names, print what it prints, and raise its errors.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from radiogs_core.errors import DataError
from radiogs_reports.summary import read_summary
from radiogs_reports.tables.model import Cell
from radiogs_reports.tables.suite import suite_table

from ..errors import CellFailed
from ..results.baseline import read_baseline
from ..results.gate import compare
from ..runs.sweep import read_sweep
from ..store.folder import Store
from .main import build_parser, execute

__all__ = ["gate", "run", "table"]

Shown = Literal["value", "difference", "low", "high", "verdict", "paper"]


def run(suite: str, out: str | Path | None = None, **options: Any) -> pd.DataFrame:
    """Run the cells of a suite that are not in ``out`` yet, print its table, and return it (see ``table``).

    ``options`` are those of ``radiogs-bench run``, such as ``scenes=["corner"]``, ``seeds=2``, ``preset="smoke"``,
    ``workers=2``, ``set={"inverse_iterations": 600}``. Raises UsageError for one that is not there, and CellFailed
    where a cell failed; the other cells are kept.
    """
    folder = Path("out") / Path(suite).stem if out is None else Path(out)
    given = ["run", suite, "--out", str(folder), *_arguments(options)]
    parsed = build_parser().parse_args(given)
    parsed.arguments = given
    code = execute(parsed)
    if code:
        raise CellFailed(f"the run ended with exit code {code}", "Some of its cells failed; each is explained above.")
    return table(folder)


def table(folder: str | Path, what: Shown = "value") -> pd.DataFrame:
    """The table of the run in a folder, as ``run`` and ``report`` print it: a line a row, a column a metric.

    ``what``: ``value`` (means; ``attrs["caption"]`` of the frame says over what), ``difference`` to the reference row,
    ``low`` and ``high`` of its 95 % interval, ``verdict`` (better, worse, or none), or ``paper`` (the published value).
    Raises DataError where no run has a table there yet.
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
    """Differences between the run in a folder and a baseline, a line each: ``severity``, ``cell``, ``what``.

    Severities are those of docs/gate.md; the run is worse where one is ``regression``. Raises DataError for results or
    a baseline that cannot be compared.
    """
    path = Path(folder)
    changes = compare(Store(path), read_sweep(path), read_baseline(Path(baseline)), slow_fails)
    return pd.DataFrame(
        [(each.severity, each.cell, each.what) for each in changes], columns=["severity", "cell", "what"]
    )


def _arguments(options: Mapping[str, Any]) -> list[str]:
    """Options by keyword as the command line has them."""
    made: list[str] = []
    for name, value in options.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, Mapping):
            for field, each in value.items():
                made += [option, f"{field}={each}"]
        elif isinstance(value, Sequence) and not isinstance(value, str):
            made += [option, ",".join(map(str, value))]
        elif value is True:
            made.append(option)
        elif value is not None and value is not False:
            made += [option, str(value)]
    return made


def _entry(cell: Cell, what: Shown) -> Any:
    if what == "value":
        return cell.value
    if what == "paper":
        return None if cell.published is None else cell.published.value
    if cell.difference is None:
        return None
    if what == "verdict":
        return cell.verdict
    return cell.difference.interval["mean" if what == "difference" else what]
