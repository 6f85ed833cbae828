"""Baselines of the gate, and changes to them that are sealed again."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from radiogs_bench.cli import main
from radiogs_bench.store.seal import sealed, strict_json

Content = dict[str, Any]


def baseline_of_run(run: Path, folder: Path, *further: str) -> Path:
    """The file of a baseline that the gate makes of a run."""
    file = folder / "baseline.json"
    assert main(["gate", str(run), "--baseline", str(file), "--update", *further]) == 0
    return file


def sealed_by_hand(file: Path, change: Callable[[Content], object]) -> Path:
    """Change a sealed file and seal it again; returns the file."""
    content = json.loads(file.read_text())
    change(content)
    file.write_bytes(strict_json(sealed(content)))
    return file


def put(value: Any, *keys: str) -> Callable[[Content], None]:
    """A change that sets an entry."""

    def change(content: Content) -> None:
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = value

    return change


def without(*keys: str) -> Callable[[Content], None]:
    """A change that deletes an entry."""

    def change(content: Content) -> None:
        for key in keys[:-1]:
            content = content[key]
        del content[keys[-1]]

    return change
