"""The labels of methods that are not what was published: what stands for what, in a sentence below the tables."""

from collections.abc import Mapping, Sequence

from radiogs_reports.summary import Doubt

from ..store.schema import Result
from ..suites.sweep import Place, Sweep


def labels(cells: Sequence[tuple[Place, Result | None]], sweep: Sweep) -> list[Doubt]:
    """A remark of no column for each set of ``labels`` among the facts of cells, with the rows that have it."""
    texts = {row["key"]: row["text"] for row in sweep["rows"]}
    rows: dict[str, dict[str, None]] = {}
    for place, result in cells:
        found = None if result is None else result["facts"].get("labels")
        if isinstance(found, Mapping) and found:
            rows.setdefault(_sentence(found), {})[place["row"]] = None
    return [
        Doubt(column="", rows=list(own), text=f"{', '.join(texts[key] for key in own)}: {text}")
        for text, own in rows.items()
    ]


def _sentence(found: Mapping[str, object]) -> str:
    return "; ".join(f"{name}: {value}" for name, value in found.items()) + "."
