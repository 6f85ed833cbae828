"""Every quick claim of docs/artifact.md: its command ends well, and prints the value within its tolerance."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CELL = re.compile(r"(?<!\\)\|")
"""The end of a cell of a Markdown table."""


def claims() -> dict[str, list[tuple[str, str, str]]]:
    """By command: printed phrase in which ``#`` is a number, value, tolerance; both are empty without a number."""
    found: dict[str, list[tuple[str, str, str]]] = {}
    for line in (ROOT / "docs" / "artifact.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip().replace(r"\|", "|") for cell in CELL.split(line)[1:-1]]
        if len(cells) == 7 and (command := re.fullmatch(r"`radiogs-bench (.*)`", cells[1])):
            found.setdefault(command[1], []).append((cells[2], cells[3], cells[4]))
    return found


def test_there_are_some() -> None:
    assert len(claims()) >= 5
    for phrase, value, tolerance in (claim for each in claims().values() for claim in each):
        assert phrase.count("#") == bool(value) == bool(tolerance), phrase


@pytest.mark.slow
@pytest.mark.parametrize("command", claims())
def test_a_quick_claim_holds(command: str, tmp_path: Path) -> None:
    shutil.copy(ROOT / ".github" / "gate-smoke.json", tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "radiogs_bench", *command.split()],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    printed = " ".join(done.stdout.split())
    for phrase, value, tolerance in claims()[command]:
        match = re.search(re.escape(phrase).replace(r"\#", r"([-+]?\d+(?:\.\d+)?)"), printed)
        assert match is not None, f"'{phrase}' is not printed:\n{printed}"
        assert not match.groups() or float(match[1]) == pytest.approx(float(value), abs=float(tolerance)), phrase
