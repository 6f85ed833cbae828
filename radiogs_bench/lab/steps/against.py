"""Passes of two checkouts in turn, each in a process of its own, measured by the checkout's own harness.

Methods, contract and harness of an earlier commit may differ from those here: what it has in common with this checkout
is what it answers (``measure.Here.passed``) and the names of sizes.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from radiogs_core.errors import UsageError

from ...errors import Killed
from .measure import Plain

SOURCE_ROOTS = (".", "method", "datasets", "baselines", "reports")
"""Folders of a checkout that hold its packages."""

WORKERS = ("radiogs_bench.lab.steps.worker", "radiogs_bench.step_bench.worker")
"""Module of the process that makes passes: its name here, and its name before 2026-11-26."""

START = """
import importlib, json, runpy, sys
module = sys.argv.pop(1)
sizes = importlib.import_module(module.rpartition(".")[0] + ".sizes").SIZES
print(json.dumps(list(sizes)), flush=True)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""
"""Program of the process: says which sizes its checkout knows, which earlier workers do not say, and becomes the
worker."""


class Worker:
    """A process that makes passes."""

    def __init__(self, process: "subprocess.Popen[str]", name: str, sizes: Sequence[str]) -> None:
        self.process, self.name = process, name
        _require_known(sizes, self._answer(), name)
        self.origin: Plain = self._answer()
        """Folder of its sources, and their commit."""

    def passed(self, size: str, counts: bool) -> Plain:
        """One pass at a size (see ``measure.Here.passed``)."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps({"size": size, "counts": counts}) + "\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # its exit code is told by what follows
        passed: Plain = self._answer()
        return passed

    def _answer(self) -> Any:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise Killed(
                f"the process that measured {self.name} ended with code {self.process.wait()}",
                "What it wrote to stderr says why.",
                "Measure it alone:  radiogs-bench bench steps",
            )
        return json.loads(line)


@contextmanager
def worker(checkout: Path | None, arguments: tuple[str, ...], sizes: Sequence[str]) -> Iterator[Worker]:
    """A worker with this checkout's sources (None) or another one's; it ends with the block.

    Raises UsageError for a folder that is no checkout, or that does not know one of the sizes, before it measures
    anything; Killed where the process ends by itself.
    """
    surroundings, module = dict(os.environ), WORKERS[0]
    if checkout is not None:
        module = _worker_of(checkout)
        roots = [(checkout / root).resolve() for root in SOURCE_ROOTS]
        before = [surroundings["PYTHONPATH"]] if surroundings.get("PYTHONPATH") else []
        surroundings["PYTHONPATH"] = os.pathsep.join([*map(str, roots), *before])
    with subprocess.Popen(
        [sys.executable, "-P", "-c", START, module, *arguments],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=surroundings,
    ) as process:  # fmt: skip
        try:
            made = Worker(process, "this checkout" if checkout is None else str(checkout), sizes)
            _require_own_sources(made.origin, checkout)
            yield made
        finally:
            process.kill()


def _worker_of(checkout: Path) -> str:
    """Module of a checkout's worker. Raises UsageError for a folder without one."""
    for module in WORKERS:
        if (checkout / f"{module.replace('.', '/')}.py").is_file():
            return module
    raise UsageError(
        f"{checkout} is no checkout of this project that can measure its steps",
        f"It has no {WORKERS[0].replace('.', '/')}.py.",
        "Make one:  git worktree add FOLDER COMMIT",
    )


def _require_known(sizes: Sequence[str], known: Sequence[str], name: str) -> None:
    """Raise UsageError where a checkout does not know a size."""
    unknown = [size for size in sizes if size not in known]
    if unknown:
        raise UsageError(
            f"{name} does not know the size {', '.join(unknown)}",
            f"It measures itself at its own sizes: {', '.join(known)}.",
            "Name some of these with --sizes.",
        )


def _require_own_sources(origin: dict[str, Any], checkout: Path | None) -> None:
    """Raise UsageError where Python found the packages elsewhere, or both sides would be the same."""
    if checkout is not None and not Path(origin["sources"]).is_relative_to(checkout.resolve()):
        raise UsageError(
            f"the packages of {checkout} are not those that were found",
            f"Python found {origin['sources']}.",
            "Is something installed that comes before PYTHONPATH?",
        )
