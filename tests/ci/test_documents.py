"""Documents are few and short, and no file holds what a merge left undecided."""

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


NOT_COUNTED = ("limits", "artifact", "protocols")
"""Pages to look things up in."""


def test_documents_stay_short_enough_to_be_read() -> None:
    words = {path.stem: len(path.read_text(encoding="utf-8").split()) for path in (ROOT / "docs").glob("*.md")}
    counted = {name: count for name, count in words.items() if name not in NOT_COUNTED}
    assert len(counted) <= 16
    assert sum(counted.values()) <= 36_000
    assert max(counted.values()) <= 2_750, max(counted, key=counted.__getitem__)
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 700
