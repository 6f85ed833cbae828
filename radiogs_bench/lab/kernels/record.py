"""Measurements of kernels as a table and as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .bench import MeasuredPass

if TYPE_CHECKING:
    from rich.table import Table

SCHEMA = "radiogs-bench/kernels/1"


def as_json(
    rows: Sequence[MeasuredPass], scaling: dict[str, float] | None, skipped: Sequence[str], session: dict[str, Any]
) -> dict[str, Any]:
    """All measurements and their provenance."""
    return {
        "schema": SCHEMA,
        **session,
        "rows": [{**asdict(row), "millions_per_second": row.millions_per_second} for row in rows],
        "scaling": scaling,
        "skipped": list(skipped),
    }


def as_table(rows: Sequence[MeasuredPass], on_gpu: bool) -> "Table":
    """One line per pass; rates are of one core on the CPU."""
    from rich.table import Table

    rate = "M/s" if on_gpu else "M/s per core"
    table = Table("kernel", "scene", "type", "pass", "item")
    for heading in (rate, "x yardstick", "hits an item", "KiB read an item", "peak MiB", "yardstick's MiB"):
        table.add_column(heading, justify="right")
    for row in rows:
        table.add_row(
            row.kernel, row.scene, row.dtype, row.direction, row.item,
            f"{row.millions_per_second:.3f}",
            "n/a" if row.ratio is None else f"{row.ratio:.2f}",
            _counter(row, "hits", "blended_pairs"),
            _counter(row, "bytes_read", digits=2, unit=2**10),
            f"{row.peak_bytes / 2**20:.1f}",
            "n/a" if row.yardstick_peak_bytes is None else f"{row.yardstick_peak_bytes / 2**20:.1f}",
        )  # fmt: skip
    return table


def _counter(row: MeasuredPass, *names: str, digits: int = 1, unit: int = 1) -> str:
    """The first of these counters that the kernel has, in units of ``unit``; empty where it has none of them."""
    return next((f"{row.counters[name] / unit:.{digits}f}" for name in names if name in row.counters), "")
