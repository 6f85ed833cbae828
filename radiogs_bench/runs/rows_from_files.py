"""Rows of a run that were scored from files which another program wrote (``score --into``).

Their cells are results like others: the key is over the files' digest in place of the method's sources. The
training is not known, so variant, stages and seconds of training are empty, and the budget is named ``UNKNOWN``. The
store alone says which rows there are; a manifest has those that its run can be compared with.
"""

import hashlib
import re
from collections.abc import Mapping
from typing import Any

from radiogs_core.errors import UsageError

from ..store.folder import Store
from ..store.schema import Result
from ..suites.experiment import FROM_FILES
from .cell import evaluation_code
from .sweep import CellRef, Sweep, TableRow

UNKNOWN = "not known"
"""Name of the budget of a row whose training nobody here has seen."""

LONGEST_NAME = 80
PLAIN = re.compile(r"[A-Za-z0-9_.-]{1,60}")


def row_key(name: str) -> str:
    """Key of the row of a name. Names with other characters than a file name's carry a digest: no two names share one.

    Raises UsageError for an empty or long name, and for one with line breaks or characters that cannot be printed.

    >>> row_key("gs-ir"), row_key("GS-IR, 30k")
    ('files-gs-ir', 'files-GS-IR-30k-a3b20f')
    """
    if name != name.strip() or not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
        raise UsageError(
            f"{name!r:.120} cannot be the name of a row",
            f"It is printed in tables: 1 to {LONGEST_NAME} printable characters on one line, no space at its ends.",
            "Give another one:  --row NAME",
        )
    if PLAIN.fullmatch(name):
        return f"files-{name}"
    words = "-".join(re.findall(r"[A-Za-z0-9_.]+", name))[:40]
    digest = hashlib.sha256(name.encode()).hexdigest()[:6]
    return "-".join(part for part in ("files", words, digest) if part)


def cell_content(name: str, files: str, scene: Mapping[str, str], seed: int, protocol: str) -> dict[str, Any]:
    """The content whose hash is the cell's key. ``files``: their digest; ``scene``: its ``checksum`` and ``loader``.

    The method is called ``NAME (files)``, so that nobody's files are taken for a method of that name that was run.
    """
    return {
        "checksum": scene["checksum"],
        "loader": scene["loader"],
        "method": f"{name} (files)",
        "variant": {},
        "budget": {"name": UNKNOWN},
        "seed": seed,
        "device": "cpu",
        "protocol": protocol,
        "stages": {},
        "method_code": files,
        "evaluation_code": evaluation_code(FROM_FILES),
        "experiment": FROM_FILES.name,
        "settings": {},
    }


def is_from_files(result: Result) -> bool:
    """Whether a result was scored from files."""
    return bool(result["cell"].get("experiment") == FROM_FILES.name)


def measured(sweep: Sweep) -> Sweep:
    """The manifest without rows that were scored from files."""
    rows = [row for row in sweep["rows"] if "files" not in row]
    keys = {row["key"] for row in rows}
    return {**sweep, "rows": rows, "cells": [ref for ref in sweep["cells"] if ref["row"] in keys]}


def with_rows_from_files(store: Store, sweep: Sweep, checksums: Mapping[str, str]) -> tuple[Sweep, list[str]]:
    """The manifest with every row of its store that was scored from files and can be compared with the run.

    ``checksums`` are the scenes' by name. A cell belongs if its scene, protocol and seed are the run's and this
    version of the code scored it; of several of one row, scene and seed the last scored one does. Also returned: names
    of the rows that another version scored, which have to be scored again.
    """
    own = measured(sweep)
    scene_of = {checksum: scene for scene, checksum in checksums.items()}
    code = evaluation_code(FROM_FILES)
    found: dict[tuple[str, str, int], Result] = {}
    outdated: set[str] = set()
    for result in store.results():
        cell = result["cell"]
        comparable = is_from_files(result) and cell["protocol"] == sweep["protocol"]
        if not comparable or cell["checksum"] not in scene_of or cell["seed"] not in sweep["seeds"]:
            continue
        if cell["evaluation_code"] != code:
            outdated.add(result["facts"]["row"])
            continue
        origin = (result["facts"]["row"], scene_of[cell["checksum"]], cell["seed"])
        if origin not in found or scored_at(found[origin]) <= scored_at(result):
            found[origin] = result
    lines = {name: _line(name, result) for (name, _, _), result in sorted(found.items(), key=lambda each: each[0])}
    places = [
        CellRef(row=row_key(name), scene=scene, seed=seed, key=result["key"], stages=[])
        for (name, scene, seed), result in sorted(found.items(), key=lambda each: each[0])
    ]
    whole: Sweep = {**own, "rows": [*own["rows"], *lines.values()], "cells": [*own["cells"], *places]}
    return whole, sorted(outdated - lines.keys())


def scored_at(result: Result) -> str:
    """When the files were scored: UTC, ISO 8601 to the microsecond."""
    return str(result["facts"]["scored"])


def _line(name: str, result: Result) -> TableRow:
    return TableRow(key=row_key(name), latex="", text=name, files=str(result["facts"]["read_as"]))
