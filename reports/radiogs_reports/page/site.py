"""The files of a published site: a table over runs, a page per scene and row, and the data of all."""

import hashlib
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypedDict

from PIL import Image

from .. import maps
from ..summary import ColumnSummary
from ..tables.model import Column, PrintedCell, PrintedRow, Table, missing_cell
from ..tables.suite import value_cell
from ..wording import heading
from .assets import rendered, scripts, styles

SITE_SCHEMA = "radiogs-bench/site/1"

DATA = "data.json"
"""Name of the site's data file, which is written first and marks a folder as a site."""

FILTERS = ("scene", "suite", "method", "division", "protocol", "preset")
PROVENANCE = ("seeds", "recipe", "date", "commit", "machine", "command")

SHOWN = ("image", "albedo", "normal", "relit")
"""The maps that a page shows, each beside its truth."""


class Line(TypedDict):
    """A row on a scene: its line in the table and its page. In a record it is a row on all scenes, without a page."""

    row: str
    page: str
    """The name of its page; empty where it has none."""
    facts: dict[str, str]
    """Texts by the names in FILTERS and PROVENANCE; empty texts are not stored."""
    values: dict[str, dict[str, float | None]]
    """By ``mean`` (over seeds) and ``seed N``, then column."""
    reasons: dict[str, str]
    """Why means are missing, by column."""
    missing: list[str]
    """Cells that are not finished, each with its state."""
    card: dict[str, list[str]]
    """The model's card: sentences by heading."""
    without: str
    """Why the page has no pictures; empty if it has some."""


def site_files(
    columns: Sequence[ColumnSummary], lines: Sequence[Line], arrays: Mapping[str, Path]
) -> Iterator[tuple[str, bytes]]:
    """Every file of the site by its name, DATA first; the same content gives the same bytes.

    ``arrays``: what pictures are made of, by page. Raises ValueError and OSError for unusable arrays.
    """
    data = {"schema": SITE_SCHEMA, "columns": columns, "lines": lines}
    yield DATA, json.dumps(data, indent=1, sort_keys=True, allow_nan=False).encode()
    missing = [each for line in lines for each in line["missing"]]
    table = _index_table(columns, lines)
    yield "index.html", _page("site.html", "sorting", "filtering", table=table, filters=FILTERS, missing=missing)
    for line in (each for each in lines if each["page"]):
        pairs = _pictures(arrays[line["page"]]) if line["page"] in arrays else {}
        yield from (picture for pair in pairs.values() for picture in pair.values())
        known = [each for each in columns if each["key"] in line["reasons"]]
        yield line["page"], _page("card.html", line=line, pairs=pairs, values=_values_table(known, line))


def _page(template: str, *names: str, **values: object) -> bytes:
    made = rendered(template, scripts(("theme", *names)), styles(("page", "tables", "site")), files=True, **values)
    return made.encode(errors="backslashreplace")


def _index_table(columns: Sequence[ColumnSummary], lines: Sequence[Line]) -> Table:
    """The table over all runs; its texts sort and filter, its labels open pages."""
    scene, *others = (Column(name, numeric=False) for name in (*FILTERS, *PROVENANCE))
    rows = []
    for line in lines:
        first, *further = (_text(line["facts"][each.label]) for each in (scene, *others))
        cells = [first, *(_value(line, "mean", column) for column in columns), *further]
        rows.append(PrintedRow(line["row"], cells, page=line["page"]))
    return Table("site", "", [scene, *(Column(**each) for each in columns), *others], rows, "Every row and scene")


def _values_table(columns: Sequence[ColumnSummary], line: Line) -> Table:
    names = list(line["values"])[len(line["values"]) == 2 :]  # the mean of a single seed is its value
    rows = [
        PrintedRow(heading(column), [*(_value(line, name, column) for name in names), _text(column.get("meaning", ""))])
        for column in columns
    ]
    caption = f"metric protocol {line['facts']['protocol']}, preset {line['facts']['preset']}"
    return Table("values", "", [*map(Column, names), Column("meaning", numeric=False)], rows, caption, lead="metric")


def _text(text: str) -> PrintedCell:
    return PrintedCell(text, text) if text else missing_cell("not stored")


def _value(line: Line, name: str, column: ColumnSummary) -> PrintedCell:
    reason = line["reasons"].get(column["key"], "its run has no such column")
    return value_cell(line["values"].get(name, {}).get(column["key"]), column, reason)


def _pictures(path: Path) -> dict[str, dict[str, tuple[str, bytes]]]:
    """Names and bytes of PNG files by map, then side, as displayed; files are named by content."""
    arrays, found = maps.read_maps(path), dict[str, dict[str, tuple[str, bytes]]]()
    for name in SHOWN:
        for side, prefix in (("truth", "truth"), ("rendered", "render")):
            if (image := arrays.get(f"{prefix}/{name}")) is not None:
                packed = io.BytesIO()
                Image.fromarray(maps.levels(maps.kind_of(name).shown(image))).save(packed, "PNG")
                content = packed.getvalue()
                file = f"pictures/{hashlib.sha256(content).hexdigest()[:20]}.png"
                found.setdefault(maps.kind_of(name).label, {})[side] = (file, content)
    return found
