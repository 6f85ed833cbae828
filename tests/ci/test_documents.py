"""No document or source holds what a merge left undecided."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
MARKS = ("<" * 7 + " ", ">" * 7 + " ")


def test_no_file_has_the_marks_of_an_undecided_merge() -> None:
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    undecided = []
    for name in filter(None, names.split("\0")):
        file = ROOT / name
        if file.suffix in {".md", ".py", ".toml", ".json", ".yml", ".txt", ".tex"} and file.is_file():
            lines = file.read_text(encoding="utf-8").splitlines()
            undecided += [f"{name}:{place}" for place, line in enumerate(lines, 1) if line.startswith(MARKS)]
    assert not undecided
