"""The project's own values by commit: a line of JSON for every time that they were measured.

Seconds of two machines cannot be compared; their ratios to a yardstick that was measured in the same run can, roughly.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radiogs_core.errors import DataError

from ...store.atomic import write_atomically

DIGITS = 4

KEYS = ("date", "commit", "dirty", "machine", "method", "yardsticks", "ratios")

Plain = dict[str, Any]


def line_of(record: Mapping[str, Any]) -> Plain:
    """The line of the history for a record of steps. Raises DataError where the sources have no commit."""
    if record["git"] is None:
        raise DataError(
            "these sources have no commit", "A history says which commit each value is of.", "Leave out --history."
        )
    machine = record["machine"]
    yardsticks = {name: each["median"] for name, each in record["yardsticks"].items()}
    return {
        "date": record["date"],
        "commit": record["git"]["commit"],
        "dirty": record["git"]["dirty"],
        "machine": f"{machine['gpu'] or machine['cpu']}, {machine['cores']} cores,"
        f" {machine['memory_bytes'] / 2**30:.0f} GiB",
        "method": record["method"],
        "yardsticks": {name: _rounded(seconds) for name, seconds in yardsticks.items()},
        "ratios": {
            size: {
                row["title"]: {name: _rounded(row["median"] / seconds) for name, seconds in yardsticks.items()}
                for row in measured["rows"]
            }
            for size, measured in record["sizes"].items()
        },
    }


def append(path: Path, line: Mapping[str, Any]) -> None:
    """Add a line to a history, or begin one. Raises DataError where the file is none."""
    lines = read_history(path) if path.exists() else []
    content = "".join(json.dumps(each, sort_keys=True, allow_nan=False) + "\n" for each in [*lines, line])
    write_atomically(path, content.encode())


def read_history(path: Path) -> list[Plain]:
    """All lines, oldest first. Raises DataError that names the first malformed line."""
    found = []
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read the history {path}: {error}", "", "Name another file with --history.") from error
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            each = json.loads(line)
        except ValueError:
            each = None
        lacking = KEYS if not isinstance(each, dict) else [name for name in KEYS if name not in each]
        if lacking:
            raise DataError(
                f"line {number} of {path} is no line of a history",
                f"It lacks {', '.join(lacking)}.",
                "Name another file with --history, or take the line out.",
            )
        found.append(each)
    return found


def titles_of(lines: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Every size and title that some line has, in the order in which they first occur."""
    return list(
        dict.fromkeys((size, title) for line in lines for size in line["ratios"] for title in line["ratios"][size])
    )


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
