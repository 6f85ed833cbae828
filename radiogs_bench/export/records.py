"""All results of a store as one table with a line per cell and metric."""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from radiogs_core.plain_values import flat
from radiogs_reports.write.csv_text import csv_of

from ..extras import extra_library
from ..runs.sweep import has_sweep, read_sweep
from ..store.atomic import write_atomically
from ..store.folder import Store
from ..store.schema import Result


def rows(
    store: Store, by_view: bool = False, advance: Callable[[int, int], None] = lambda done, total: None
) -> Iterator[dict[str, Any]]:
    """Every metric of every finished cell, with the cell's settings and costs; with ``by_view``, every view's value.

    Columns: row (None for a cell that is not part of the folder's last run), scene, method, variant fields, budget,
    seed, device, protocol; surfels; seconds by stage; counters of work and of guards, summed over stages; key; metric,
    value, reason. With ``by_view``: view instead of reason; views without a value have no line. Raises DataError for a
    damaged manifest.
    """
    named = {ref["key"]: ref["row"] for ref in read_sweep(store.folder)["cells"]} if has_sweep(store.folder) else {}
    total = len(store.result_keys())
    for done, result in enumerate(store.results(), start=1):
        common = {"row": named.get(result["key"]), **_of_cell(result)}
        for metric, each in sorted(result["metrics"].items()):
            if not by_view:
                yield {**common, "metric": metric, "value": each["value"], "reason": each["reason"]}
                continue
            for view, value in zip(result["views"], each["views"], strict=True):
                if value is not None:
                    yield {**common, "metric": metric, "view": view, "value": value}
        advance(done, total)


def export(store: Store, path: Path, form: str, advance: Callable[[int, int], None]) -> int:
    """Write the table; returns its number of lines. ``advance``: reports how many cells of all have been read.

    Raises UsageError, before any cell is read, if pandas cannot write the format here.
    """
    if form == "parquet":
        extra_library("pyarrow", "parquet needs pyarrow", "parquet")
    lines = list(rows(store, advance=advance))
    table = pd.DataFrame(lines)
    if form == "parquet":
        content = table.to_parquet(index=False)
    elif form == "csv":
        content = csv_of(lines).encode()
    else:
        # Not by pandas, which rounds to at most 15 decimals: a small error would lose its digits.
        content = json.dumps([{name: line.get(name) for name in table} for line in lines], indent=1).encode()
    write_atomically(path, content)
    return len(table)


def _over_stages(counted: Mapping[str, Mapping[str, int]]) -> Counter[str]:
    total: Counter[str] = Counter()
    for counters in counted.values():
        total.update(counters)
    return total


def _of_cell(result: Result) -> dict[str, Any]:
    cell = result["cell"]
    work, guards = _over_stages(result["work"]), _over_stages(result["guards"])
    return {
        "scene": result["scene"],
        "method": cell["method"],
        **{f"variant.{name}": value for name, value in flat(cell["variant"]).items()},
        "budget": cell["budget"]["name"],
        **{name: cell[name] for name in ("seed", "device")},
        "protocol": result["protocol"]["name"],
        "surfels": result["facts"].get("surfels"),
        **{f"seconds.{stage}": seconds for stage, seconds in result["seconds"].items()},
        **{f"work.{name}": amount for name, amount in sorted(work.items())},
        **{f"guards.{name}": amount for name, amount in sorted(guards.items())},
        "key": result["key"],
    }
