"""Breaks copies of the sources in known ways and says which of them the tests let pass.

    python .ci/mutants.py [--only NAME ...] [--list] [--jobs N]

``mutants.toml`` has the mutants: a file, a text that occurs in it exactly once, what replaces it, and the tests that
should notice. First these tests run on the sources as they are: a test that fails anyway kills nothing. Then each
mutant is applied to a copy of the tracked files, and its tests run there until the first one fails. Exit status 1 if a
mutant survives, does not apply, or cannot be run at all. ``sample_mutants.py`` draws others at random.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

ROOT = Path(__file__).parents[1]
LIST = ROOT / ".ci" / "mutants.toml"
ROOMS = ("", "method", "datasets", "baselines", "reports")
"""Source roots, which a copy puts before the installed ones."""

LONGEST = 300.0
"""Seconds for each file or test, after which tests that do not end count as failed."""

VERDICTS = {0: "SURVIVED", 1: "killed", None: "killed"}
"""By pytest's exit status; with any other one that is not negative the tests could not be run."""


@dataclass(frozen=True)
class Mutant:
    """``before`` becomes ``after`` in ``file`` (from the root); ``tests``: files or node ids that should notice."""

    name: str
    file: str
    before: str
    after: str
    tests: tuple[str, ...]

    def applied(self, text: str) -> str:
        """The mutated text. Raises ValueError unless ``before`` occurs exactly once and differs from ``after``."""
        if (found := text.count(self.before)) != 1:
            raise ValueError(f"{self.name}: the text before occurs {found} times in {self.file}: {self.before!r}")
        if self.before == self.after:
            raise ValueError(f"{self.name}: nothing changes")
        return text.replace(self.before, self.after)


@dataclass(frozen=True)
class Outcome:
    """The outcome of a mutant, and pytest's output."""

    mutant: Mutant
    verdict: str
    seconds: float
    output: str = ""


def listed(path: Path = LIST) -> list[Mutant]:
    """The mutants of a file, in its order."""
    entries = tomllib.loads(path.read_text())["mutant"]
    return [Mutant(**entry | {"tests": tuple(entry["tests"])}) for entry in entries]


NOBODY = ["-c", "user.name=nobody", "-c", "user.email=nobody@localhost"]
"""Options of git for a commit on any machine."""


@contextmanager
def copies(root: Path, count: int) -> Iterator[list[Path]]:
    """Checkouts with the tracked files as they are in the working tree, at a commit of their own."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=root, check=True, capture_output=True, text=True).stdout
    with tempfile.TemporaryDirectory(prefix="mutants-") as temporary:
        folders = [Path(temporary) / str(number) for number in range(count)]
        for folder in folders:
            for name in filter(None, names.split("\0")):
                if (root / name).is_file():
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(root / name, folder / name)
            for command in (["init"], [*NOBODY, "commit", "--allow-empty", "--message", "A copy"]):
                subprocess.run(["git", *command, "--quiet"], cwd=folder, check=True)
        yield folders


def run_tests(folder: Path, tests: Sequence[str], *options: str, seconds: float) -> tuple[int | None, str]:
    """Pytest's exit status and output on a copy; None as status if it is not done in time."""
    path = os.pathsep.join(str(folder / room) for room in ROOMS)
    command = [sys.executable, "-m", "pytest", "-q", *options, *tests]
    # Compiled once, as a copy is used for many mutants: a third of the time that a single test takes.
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    try:
        done = subprocess.run(
            command, cwd=folder, env=kept | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=seconds
        )
    except subprocess.TimeoutExpired:
        return None, f"not done after {seconds:g} s"
    return done.returncode, done.stdout + done.stderr


def in_parallel(jobs: int) -> tuple[str, ...]:
    """Pytest's options for that many processes."""
    return ("--numprocesses", str(jobs), "--dist", "loadfile") if jobs > 1 else ()


@contextmanager
def mutated(mutant: Mutant, folder: Path) -> Iterator[None]:
    """The copy with the mutant in it. Raises ValueError where it does not apply."""
    file = folder / mutant.file
    text = file.read_text()
    rewrite(file, mutant.applied(text))
    try:
        yield
    finally:
        rewrite(file, text)


def rewrite(file: Path, text: str) -> None:
    """Write a source, and forget what it was compiled to: Python tells versions apart by size and whole seconds."""
    file.write_text(text)
    for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*"):
        compiled.unlink()


def tried(mutant: Mutant, folder: Path) -> Outcome:
    """The mutant's tests, run on the copy with it."""
    begun = time.monotonic()
    try:
        with mutated(mutant, folder):
            status, output = run_tests(folder, mutant.tests, "-x", seconds=LONGEST * len(mutant.tests))
    except (ValueError, OSError) as error:
        return Outcome(mutant, "DOES NOT APPLY", 0.0, str(error))
    # A signal's number, negative: the mutant took Python itself down, which nobody overlooks.
    verdict = "killed" if status is not None and status < 0 else VERDICTS.get(status, "CANNOT RUN")
    return Outcome(mutant, verdict, time.monotonic() - begun, output if verdict == "CANNOT RUN" else "")


def outcomes(
    mutants: Sequence[Mutant], folders: Sequence[Path], outcome: Callable[[Mutant, Path], Outcome] = tried
) -> Iterator[Outcome]:
    """Each mutant's, in order; as many at a time as there are copies."""
    free: SimpleQueue[Path] = SimpleQueue()
    for folder in folders:
        free.put(folder)

    def one(mutant: Mutant) -> Outcome:
        folder = free.get()
        try:
            return outcome(mutant, folder)
        finally:
            free.put(folder)

    with ThreadPoolExecutor(len(folders)) as pool:
        yield from pool.map(one, mutants)


def check(mutants: Sequence[Mutant], root: Path, jobs: int) -> int:
    """Try them all, print what became of each, and return the exit status."""
    every = {test for mutant in mutants for test in mutant.tests}
    tests = sorted(test for test in every if "::" not in test or test.partition("::")[0] not in every)
    with copies(root, jobs) as folders:
        begun = time.monotonic()
        status, output = run_tests(folders[0], tests, *in_parallel(jobs), seconds=LONGEST * len(tests))
        if status != 0:
            say(output, f"the tests do not pass without any mutant (exit status {status}): nothing can be said")
            return 1
        say(f"{'without':9} {time.monotonic() - begun:6.1f} s  {len(tests)} files or tests, all pass")
        alive = []
        for outcome in outcomes(mutants, folders):
            say(f"{outcome.verdict:9} {outcome.seconds:6.1f} s  {outcome.mutant.name}", outcome.output)
            if outcome.verdict != "killed":
                alive.append(outcome.mutant.name)
    say(f"{len(mutants) - len(alive)} of {len(mutants)} mutants killed", *(f"not killed: {name}" for name in alive))
    return 1 if alive else 0


def say(*lines: str) -> None:
    """Print at once, also into a pipe; what is empty is left out."""
    sys.stdout.writelines(f"{line.rstrip()}\n" for line in lines if line)
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None, root: Path = ROOT, file: Path = LIST) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these mutants alone")
    parser.add_argument("--list", action="store_true", help="print their names and files, and run nothing")
    parser.add_argument("--jobs", type=int, default=2, help="how many at a time (default: 2)")
    given = parser.parse_args(arguments)
    mutants = listed(file)
    if unknown := set(given.only or ()) - {mutant.name for mutant in mutants}:
        parser.error(f"no mutant is called {', '.join(sorted(unknown))} (see --list)")
    mutants = [mutant for mutant in mutants if not given.only or mutant.name in given.only]
    if given.list:
        say(*(f"{mutant.name:45} {mutant.file}" for mutant in mutants))
        return 0
    return check(mutants, root, max(1, given.jobs))


if __name__ == "__main__":
    sys.exit(main())
