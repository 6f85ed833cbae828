"""Checks that documents have measured values between marks, where a command writes or a test compares them.

    python .ci/values.py

A value is a number with dB, degrees, a time, bytes or a percentage. A part between ``<!-- from records/NAME.md -->``,
``<!-- measured NAME -->`` or ``<!-- rehearsal NAME -->`` and its end is not counted, and neither is a block of code.
``values.toml`` says how many values a document may have outside such parts, and why: tolerances and settings are no
measurements. A document with more values than that fails, and one with fewer, so that the list only shrinks.
"""

import re
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]

MARKED = re.compile(
    r"<!-- (?:from records/|measured |rehearsal ).*?<!-- end of (?:record|measured|rehearsal) -->|```.*?```", re.DOTALL
)
"""A part whose values a command writes or a test compares; a block of code."""

UNITS = (
    *("dB", "degrees", "degree", "deg", "°", "%"),
    *("ms", "s", "seconds", "minutes", "hours"),
    *("kB", "MB", "GB", "MiB", "GiB"),
)

VALUE = re.compile(rf"(?<![\w.])[+-]?\d[\d,]*(?:\.\d+)?[ -]?(?:{'|'.join(UNITS)})(?!\w)")
"""A number with its unit."""


def values_outside(text: str) -> list[str]:
    """The values of a document that stand outside marks, in their order."""
    return VALUE.findall(MARKED.sub("", text))


def findings(documents: Mapping[str, str], allowed: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Faults of documents, by name; ``allowed``: the values of each, ``most``, and the reason, ``why``."""
    found = [f"{name}: .ci/values.toml lists it, and it is not there" for name in allowed.keys() - documents.keys()]
    found += [f"{name}: .ci/values.toml gives no reason" for name, each in allowed.items() if not each.get("why")]
    for name, text in documents.items():
        values, most = values_outside(text), allowed.get(name, {}).get("most", 0)
        if len(values) != most:
            last = f"; the last: {values[-1]}" if len(values) > most else ""
            found.append(f"{name}: {len(values)} values outside marks, {most} in .ci/values.toml{last}")
    return found


def documents(root: Path) -> dict[str, str]:
    """README and the pages of the documentation by name; records are written by a command."""
    paths = [root / "README.md", *sorted((root / "docs").glob("*.md"))]
    return {str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in paths}


def main(root: Path = ROOT) -> int:
    """Check every document; 1 if there is any finding."""
    allowed = tomllib.loads((root / ".ci" / "values.toml").read_text(encoding="utf-8"))
    found = findings(documents(root), allowed)
    sys.stdout.writelines(f"{line}\n" for line in [*found, f"{len(found)} documents with values outside marks"])
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
