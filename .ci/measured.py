"""Lists the records by age and which of them are stale; with a name, makes that record anew.

    python .ci/measured.py [NAME]

A record is current if its commands, planned by this checkout, have the cells that it holds, by their keys: the digests
of the sources that compute a cell, without comments and documentation, its settings and its scene. Exit status 1 if any
is stale. A record is made anew from its own commands, in out/measured/NAME, with its page.
"""

import argparse
import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from radiogs_bench.results.records import RECORDS, read_record
from radiogs_reports.summary import RecordedRun

ROOT = Path(__file__).parents[1]
HARNESS = (sys.executable, "-m", "radiogs_bench")


def words_of(run: RecordedRun) -> list[str]:
    """The command of a run, without the program."""
    return shlex.split(run["origin"]["Command"])[1:]


def planned_keys(run: RecordedRun, folder: str) -> dict[str, str]:
    """The key of every cell that the command of a run has today, by label."""
    planned = [*HARNESS, *words_of(run), "--dry-run", "--json", "--out", folder]
    done = subprocess.run(planned, capture_output=True, text=True, check=True, cwd=ROOT)
    events = [json.loads(line) for line in done.stdout.splitlines()]
    return {event["cell"]: event["key"] for event in events if event["event"] == "planned"}


def staleness(recorded: Mapping[str, str], planned: Mapping[str, str]) -> str:
    """Why a run that holds the recorded cells is stale; empty if it is not."""
    if not recorded:
        return "it does not say which cells it holds"
    if changed := [cell for cell, key in recorded.items() if planned.get(cell) != key]:
        return f"{len(changed)} of {len(recorded)} cells would be computed otherwise, such as {changed[0]}"
    return "" if len(planned) == len(recorded) else "its command has further cells"


def listed() -> int:
    """Print every run of every record, the oldest first; returns 1 if any is stale."""
    runs = [(run["origin"]["Date"], path.stem, run) for path in RECORDS.glob("*.json") for run in read_record(path)]
    stale = 0
    with tempfile.TemporaryDirectory() as folder:
        for date, name, run in sorted(runs, key=lambda each: each[0]):
            recorded = run.get("keys", {})
            try:
                why = staleness(recorded, planned_keys(run, folder) if recorded else {})
            except subprocess.CalledProcessError as failed:
                why = f"its command fails: {failed.stderr.strip().partition(chr(10))[0]}"
            stale += bool(why)
            recipe = "recipes by row" if " by " in run["recipe"] else run["recipe"] or "default"
            made = f"{date}  {run['origin']['Commit']}  {name}, {recipe}"
            sys.stdout.write(f"{made}: {why or 'current'}\n")
    return int(stale > 0)


def made_anew(name: str) -> int:
    """Run the commands of a record again and write it and its page; returns the exit status of what failed."""
    record, folders = RECORDS / f"{name}.json", []
    for number, run in enumerate(read_record(record)):
        folders.append(f"out/measured/{name}/{number}")
        if status := ran([*words_of(run), "--out", folders[-1]]):
            return status
    return ran(["record", *folders, "--to", str(record), "--markdown", str(ROOT / "docs" / "records" / f"{name}.md")])


def ran(words: Sequence[str]) -> int:
    """Run a command of the harness; returns its exit status."""
    return subprocess.run([*HARNESS, *words], check=False, cwd=ROOT).returncode


def main() -> int:
    """Run from the command line; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("name", nargs="?", metavar="NAME", help="Make this record anew, such as 'ablations'.")
    name = parser.parse_args().name
    return listed() if name is None else made_anew(name)


if __name__ == "__main__":
    sys.exit(main())
