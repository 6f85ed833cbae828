"""Killed at any moment of writing, a sweep continues to the same table and repeats nothing that was finished."""

import json
import subprocess
import sys
from pathlib import Path


def test_a_sweep_killed_at_any_write_ends_with_the_same_table(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "bench.kill_everywhere", str(tmp_path)]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert len(report["table"]) == 2
    assert report["events"] > 30
    for killed in report["killed"]:
        assert killed["survived"] == 0, f"event {killed['deadly']} did not kill"
        assert killed["repeated"] == [], f"killed at event {killed['deadly']}"
        assert killed["same"], f"killed at event {killed['deadly']}"
        assert killed["left"] == [], f"killed at event {killed['deadly']}"
        assert not killed["aside"], f"killed at event {killed['deadly']}"
