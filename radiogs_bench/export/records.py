"""All results of a store as one table, with one line per cell and metric."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from radiogs_core.plain_values import flat
from radiogs_reports.write.records import csv_of

from ..extras import extra_library
from ..store.atomic import write_atomically
from ..store.folder import Store
from ..store.schema import Result


def rows(store: Store) -> Iterator[dict[str, Any]]:
    """Every metric of every finished cell, with the cell's settings and costs.

    Columns: scene, method, variant fields, budget, seed, device, protocol, metric, value, reason; seconds by stage;
    counters of work and of guards, summed over stages; surfels; key.
    """
    for result in store.results():
        common = _of_cell(result)
        for metric, each in sorted(result["metrics"].items()):
            yield {**common, "metric": metric, "value": each["value"], "reason": each["reason"]}


def export(store: Store, path: Path, form: str) -> int:
    """Write the table; returns its number of lines. Raises UsageError if pandas cannot write the format here."""
    lines = list(rows(store))
    table = pd.DataFrame(lines)
    if form == "parquet":
        extra_library("pyarrow", "parquet needs pyarrow", "parquet")
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
