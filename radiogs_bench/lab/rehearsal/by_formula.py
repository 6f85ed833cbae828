"""Memory of a run's phases at any size, by the formula of a method that has one; nothing is run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from radiogs_core.capabilities import MemoryPhase, PlansMemory, TrainingImages
from radiogs_core.errors import UsageError
from radiogs_core.scene.scene import Scene

from ...method_calls import calling
from .row import Row

GIB = 2**30
SCHEMA = "radiogs-bench/memory/1"


def by_formula(
    name: str, rows: Sequence[Row], scene: Scene, sizes: Sequence[int], there: int, preset: str
) -> dict[str, Any]:
    """Each row's phases at each size (none: that at the start, and the largest), and whether ``there`` bytes hold them.

    Raises UsageError where no row's method has a formula, or one that has does not say its sizes and none are given.
    """
    camera = scene.train[0].camera
    images = TrainingImages(len(scene.train), camera.width, camera.height)
    known = [row for row in rows if isinstance(row.method, PlansMemory)]
    if not known:
        raise UsageError(
            f"no formula is known for the memory of {', '.join(dict.fromkeys(row.method.name for row in rows))}",
            "",
            "Leave out --by-formula: a rehearsal measures it.",
        )
    return {
        "schema": SCHEMA,
        "name": name,
        "preset": preset,
        "images": asdict(images),
        "memory": there,
        "unknown": [row.key for row in rows if row not in known],
        "rows": {row.key: _of_row(row, sizes, images) for row in known},
    }


def _of_row(row: Row, sizes: Sequence[int], images: TrainingImages) -> dict[str, Any]:
    chosen = sizes or row.sizes()
    if not chosen:
        raise UsageError(f"{row.method.name} does not say how large its models are", "", "Give --sizes.")
    found: dict[str, Any] = {"size_name": getattr(row.method, "size_name", "size"), "sizes": {}}
    for size in dict.fromkeys(chosen):
        with calling(row.method.name, "memory()"):
            phases: Sequence[MemoryPhase] = row.method.memory(row.variant, row.budget, size, images)  # type: ignore[attr-defined]
        found["sizes"][str(size)] = [asdict(phase) for phase in phases]
    return found


def fit(record: Mapping[str, Any]) -> bool:
    """Whether every phase of every row fits at every size."""
    rows = record["rows"].values()
    return all(_peak(phases) <= record["memory"] for row in rows for phases in row["sizes"].values())


def lines_of(record: Mapping[str, Any]) -> list[str]:
    """The record in Markdown: a table a row, and what fits."""
    images, there = record["images"], record["memory"]
    lines = [
        f"By formula, not measured: preset {record['preset']}, {images['views']} training views of {images['width']} x"
        f" {images['height']}.",
        "",
    ]
    for key, row in record["rows"].items():
        sizes = row["sizes"]
        heads = [f"{int(size):,} {row['size_name']}: held, GiB | peak" for size in sizes]
        lines += [f"| {key} | " + " | ".join(heads) + " |", "|---|" + "---:|---:|" * len(sizes)]
        for same in zip(*sizes.values(), strict=True):
            cells = [f"{phase['held'] / GIB:.2f} | {phase['peak'] / GIB:.2f}" for phase in same]
            lines.append(f"| {same[0]['title']} | " + " | ".join(cells) + " |")
        lines.append("")
        for size, phases in sizes.items():
            verdict = "fits" if _peak(phases) <= there else "**does not fit**"
            lines.append(
                f"- {int(size):,} {row['size_name']}: {_peak(phases) / GIB:.2f} GiB of {there / GIB:.1f}: {verdict}."
            )
    if record["unknown"]:
        lines += ["", f"No formula: {', '.join(record['unknown'])}."]
    return lines


def _peak(phases: Sequence[Mapping[str, Any]]) -> int:
    return max(phase["peak"] for phase in phases)
