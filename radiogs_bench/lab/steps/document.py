"""Writes the tables of measured steps into a document, from what was stored; nothing in them is typed by hand.

    python -m radiogs_bench.lab.steps.document docs/performance.md docs/performance/*.json*

A table of ``NAME.json`` or ``NAME.jsonl`` stands between the lines ``<!-- measured NAME -->`` and
``<!-- end of measured -->``.
"""

import json
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from radiogs_core.errors import DataError

from ..kernels.record import SCHEMA as KERNELS
from .growth import SCHEMA as GROWTH
from .growth_table import constant_said, exponent_said, ranged, within
from .history import read_history, titles_of
from .ratios import AGAINST
from .record import SCHEMA as STEPS
from .record import ends, frames_said, headline, milliseconds, parts_said, yardstick_said
from .sizes import SIZES

END = "<!-- end of measured -->"
LAST = 8
"""Lines of a history that are shown."""

BLOCKS = "▁▂▃▄▅▆▇█"


def with_tables(text: str, tables: Mapping[str, Sequence[str]]) -> str:
    """The document with each table in its place. Raises DataError where a place is missing."""
    for name, lines in tables.items():
        begin = f"<!-- measured {name} -->"
        place = re.search(re.escape(begin) + ".*?" + re.escape(END), text, re.DOTALL)
        if place is None:
            raise DataError(f"the document has no place for '{name}'", f"It lacks {begin} ... {END}.")
        text = text[: place.start()] + "\n".join([begin, *lines, END]) + text[place.end() :]
    return text


def table_of(path: Path) -> list[str]:
    """The table of a stored file. Raises DataError for a file of no kind that has one."""
    if path.suffix == ".jsonl":
        return list(history_lines(read_history(path)))
    record = json.loads(path.read_bytes())
    kinds: dict[str, Callable[[Mapping[str, Any]], Iterator[str]]] = {
        STEPS: steps_lines,
        AGAINST: against_lines,
        GROWTH: growth_lines,
        KERNELS: kernels_lines,
    }
    if record.get("schema") not in kinds:
        raise DataError(f"{path} has schema {record.get('schema')!r}", f"There are: {', '.join(kinds)}.")
    return list(kinds[record["schema"]](record))


def _where(record: Mapping[str, Any]) -> str:
    machine, git = record["machine"], record["git"] or {"commit": "unknown", "dirty": False}
    commit = git["commit"][:7] + (" with changes" if git["dirty"] else "")
    return f"{machine['gpu'] or machine['cpu']}, one core, {record['date'][:10]}, commit {commit}."


def steps_lines(record: Mapping[str, Any]) -> Iterator[str]:
    """A table for each size."""
    yield f"`{record['method']}` on `{record['scene']}`. {_where(record)} {yardstick_said(record)}."
    for name in sorted(record["sizes"], key=list(SIZES).index):
        size = record["sizes"][name]
        yield from ["", f"**{headline(name, size)}**", ""]
        yield "| | median | 95 % interval | operations | launches | where its time goes |"
        yield "|---|---:|---:|---:|---:|---|"
        for row in size["rows"]:
            yield (
                f"| {row['title']} | {milliseconds(row['median'])} | {ends(row['low'], row['high'])}"
                f" | {row['operations']:,} | {row['launches']:,} | {parts_said(row['parts'])} |"
            )
        if said := " ".join(frames_said(size)):
            yield from ["", said]
    yield ""


def against_lines(record: Mapping[str, Any]) -> Iterator[str]:
    """A table of two checkouts for each size."""
    before = (record["commits"]["other"] or {"commit": "unknown"})["commit"][:7]
    yield f"`{record['method']}` on `{record['scene']}`. {_where(record)} Before: commit {before}."
    for name in sorted(record["ratios"], key=list(SIZES).index):
        yield from ["", f"**{headline(name, record['this'][name])}**", ""]
        yield "| | before | now | times as fast | 95 % interval | operations | work that changed |"
        yield "|---|---:|---:|---:|---:|---:|---|"
        for row in record["ratios"][name]:
            ratio = "too short" if row["value"] is None else f"{row['value']:.2f}"
            interval = "" if row["low"] is None else f"{row['low']:.2f} to {row['high']:.2f}"
            operations = " to ".join(f"{count:,}" for count in row["operations"])
            work = ", ".join(f"{what} x {factor:.2f}" for what, factor in row["other work"].items())
            yield (
                f"| {row['title']} | {milliseconds(row['before'])} | {milliseconds(row['now'])} | {ratio} | {interval}"
                f" | {operations} | {work} |"
            )
    yield ""


def growth_lines(record: Mapping[str, Any]) -> Iterator[str]:
    """A line for each thing and what grows."""
    yield from [_where(record), ""]
    yield "| | grows | while | seconds: from | to | constant | exponent | at the end | bytes: from | to | at the end |"
    yield "|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|"
    for row in record["rows"]:
        mark = {True: "", False: " **above what is expected**", None: ""}[within(row)]
        low, high = row["values"][0], row["values"][-1]
        of_bytes = row["last exponent of bytes"]
        by_bytes = "n/a" if of_bytes is None else f"{of_bytes:.2f}"
        yield (
            f"| {row['title']} | {row['grows']}, {low:,} to {high:,} | {row['fixed']}"
            f" | {milliseconds(row['seconds'][0])} | {milliseconds(row['seconds'][-1])}"
            f" | {constant_said(row)} | {exponent_said(row)} | {ranged(row['last exponent'])}{mark}"
            f" | {_mebibytes(row['bytes'][0])} | {_mebibytes(row['bytes'][-1])} | {by_bytes} |"
        )
    yield ""


def kernels_lines(record: Mapping[str, Any]) -> Iterator[str]:
    """A line for each kernel on each scene: forward, backward and both."""
    yield from [_where(record), ""]
    yield "| kernel | on | items | float32: million items a second | yardstick's time over ours | float64 |"
    yield "|---|---|---|---|---|---|"
    for kernel, scene in dict.fromkeys((row["kernel"], row["scene"]) for row in record["rows"]):
        single, double = (
            [row for row in record["rows"] if (row["kernel"], row["scene"], row["dtype"]) == (kernel, scene, dtype)]
            for dtype in ("float32", "float64")
        )
        speed = ", ".join(f"{row['millions_per_second']:.3g}" for row in single)
        items = f"{single[0]['items']:,} {single[0]['item']}s"
        yield f"| {kernel} | {scene} | {items} | {speed} | {_over(single)} | {_over(double)} |"
    if (scaling := record["scaling"]) is not None:
        ways = " and ".join(f"{way} {scaling[way]:.2f} times as fast" for way in ("forward", "backward"))
        yield from ["", f"Two threads trace M {ways} (wall time)."]
    yield ""


def _over(rows: Sequence[Mapping[str, Any]]) -> str:
    ratios = [row["ratio"] for row in rows]
    return ", ".join("n/a" if ratio is None else f"{ratio:.2f}" for ratio in ratios)


def history_lines(lines: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Ratios to Embree of the last lines, where it was there, else to PyTorch's product; and their course."""
    if not lines:
        yield "Nothing was kept yet."
        return
    shown = lines[-LAST:]
    names = {name for line in shown for name in line["yardsticks"]}
    yardstick = min((name for name in names if name.startswith("Embree")), default=min(names))
    yield f"Seconds over those of {yardstick}, in the same run."
    heads = [f"{line['date'][:10]} {line['commit'][:7]}{'+' if line['dirty'] else ''}" for line in shown]
    yield from ["", f"| | {' | '.join(heads)} | course |", "|---|" + "---:|" * len(heads) + "---|"]
    for size, title in titles_of(shown):
        found = [line["ratios"].get(size, {}).get(title, {}).get(yardstick) for line in shown]
        cells = ["" if value is None else f"{value:.3g}" for value in found]
        yield f"| {size}: {title} | {' | '.join(cells)} | {_course(found)} |"
    machines = list(dict.fromkeys(line["machine"] for line in shown))
    yield from ["", f"Machines: {'; '.join(machines)}. `+`: with uncommitted changes.", ""]


def _course(values: Sequence[float | None]) -> str:
    """Heights in eighths of the largest value; nothing for a single one, or where all are below the clock's tick."""
    known = [value for value in values if value is not None]
    if len(known) < 2 or not any(known):
        return ""
    return "".join(" " if value is None else BLOCKS[round(7 * value / max(known))] for value in values)


def _mebibytes(amount: int) -> str:
    return f"{amount / 2**20:.1f} MiB"


def main(arguments: Sequence[str]) -> None:
    """Write the tables of the files named after the document into it."""
    document, *files = map(Path, arguments)
    tables = {path.stem: table_of(path) for path in files}
    document.write_text(with_tables(document.read_text(encoding="utf-8"), tables), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
