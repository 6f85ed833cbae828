"""Assembles ``report.html``, the run as one page that needs no network and no server."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from radiogs_core.own_files import fresh

from .. import maps
from ..analyses import reports_of
from ..analysis.pareto import points
from ..analysis.samples import COSTS, cost_of
from ..figures.canvas import Drawn
from ..summary import Summary, counted_scenes, protocol_title
from ..tables.caption import origin, run_note
from ..tables.model import Table
from ..tables.record import HEADING, record_reports
from ..tables.suite import suite_table
from ..wording import SYMBOL, marked
from .assets import VIEWER, json_for_script, part, rendered, scripts, styles
from .pictures import FOLDER, KIND, Album, album, filter_tables, scale_bar
from .sheets import encoded
from .surfels import Packed, packed_surfels
from .tables import cells_table, grid_table, paper_tables

SCRIPTS = (
    "shared", "theme", "sorting", "means", "scatter", "views", "sheets", "zooming", "browser", "gallery", *VIEWER,
    "provenance", "printing", "selection",
)  # fmt: skip
"""Scripts in the order in which they run: all may use the first, and the last one sends the selection to the others."""

METRICS_OF = {
    "image": "nvs/psnr", "albedo": "albedo/psnr", "normal": "normal/mae", "roughness": "roughness/mse",
    "indirect": "indirect/psnr",
}  # fmt: skip
"""By kind of map: the metric whose value of the view is shown below it. Relit views are scored over all lights."""

STYLES = ("page", "tables", "comparison", "printing")


LARGEST = 15_000_000
"""Bytes of a page in a single file, about: what mail accepts. Pictures may take a third in any case."""


def write_page(
    summary: Summary, out: Path, figures: Sequence[Drawn] = (), beside: bool = False, pictures: bool = True
) -> list[Path]:
    """Write ``report.html`` into ``out`` and return its path, then those of the pictures that are files beside it.

    The same stored results give the same bytes. ``figures``: to be shown. ``beside``: all pictures are files in a
    folder; else as many as fit are in the page. Without ``pictures`` it has no images or surfels, and a note.
    """
    path = fresh(out / "report.html", out)
    runs = summary["runs"] if pictures else []
    note = run_note(summary) if pictures else f"{run_note(summary)} {WITHOUT_PICTURES}"
    surfels = packed_surfels(runs, out)
    without = len(page(summary, Album(), figures, surfels, note))
    made = album(runs, out, None if beside else max(LARGEST // 3, LARGEST - without))
    text = page(summary, made, figures, surfels, note)
    path.write_text(text, encoding="utf-8", errors="backslashreplace")
    return [path, *made.files.values()]


WITHOUT_PICTURES = "Figures, images and surfels are left out: `radiogs-bench report` on this folder adds them."


def page(
    summary: Summary,
    pictures: Album,
    figures: Sequence[Drawn] = (),
    surfels: Mapping[str, Packed] | None = None,
    note: str = "",
) -> str:
    """The page as text. ``surfels``: of cells by key, for its 3-D view. ``note``: on the run, else ``run_note``."""
    means = replace(suite_table(summary), name="means", title="", caption=summary["title"])
    script = "\n".join([part("vendor", "uplot", "uPlot.iife.min.js"), scripts(SCRIPTS)])
    style = "\n".join([part("vendor", "uplot", "uPlot.min.css"), styles(STYLES)])
    return rendered(
        "page.html",
        script,
        style,
        files=bool(pictures.files),
        summary=summary,
        scenes=[marked(summary, scene) for scene in summary["scenes"]],
        protocol=protocol_title(summary),
        origin=origin(summary),
        downloads=downloads(summary),
        tables=[means, cells_table(summary)],
        paper=[each for table in summary["paper"] for each in paper_tables(table, summary)],
        analyses=[(each, made.sentences, list(map(grid_table, made.grids))) for each, made in reports_of(summary)],
        records=[(each, grid_table(each.by_scene)) for each in record_reports(summary)],
        record_heading=HEADING,
        figures=[(data_address(each.png.read_bytes(), "png"), each) for each in figures],
        note=note or run_note(summary),
        scattered=any(points(summary, column, cost) for column in summary["columns"] for cost in COSTS),
        finished=sum(run["state"] == "finished" for run in summary["runs"]),
        selectable=selectable(summary),
        by_view=any(run.get("by_view") for run in summary["runs"]),
        costs=COSTS,
        filter_tables=filter_tables(),
        scale_bar=data_address(encoded(maps.levels(scale_bar())), "webp"),
        pictures=pictures,
        surfels=surfels or {},
        data=json_for_script(data(summary, means, pictures)),
    )


def data_address(content: bytes, kind: str) -> str:
    """A picture of a kind of file as a data address."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def data(summary: Summary, means: Table, pictures: Album) -> dict[str, Any]:
    """The input of the scripts: the cells, and the points of the scatter plot by metric and cost.

    ``means``: the table whose values follow the ticked cells.
    """
    columns = [column for column in summary["columns"] if any(run["metrics"].get(column["key"]) is not None
               for run in summary["runs"])]  # fmt: skip
    return {
        "columns": columns,
        "table": [{"key": each.key, "decimals": each.decimals, "direction": each.direction} for each in means.columns],
        "costs": COSTS,
        "rows": [{"key": row["key"], "text": row["text"]} for row in summary["rows"]],
        "reference": summary["reference"],
        "points": {
            column["key"]: {cost: [point._asdict() for point in points(summary, column, cost)] for cost in COSTS}
            for column in columns
        },
        "kinds": summary.get("kinds", {}),
        "counted": counted_scenes(summary),
        "runs": [{**run, "cost": {cost: cost_of(run, cost) for cost in COSTS}} for run in summary["runs"]],
        "maps": {name: _look(name) for name in pictures.maps},
        "files": {"folder": FOLDER, "kind": KIND},
        "conventions": summary["conventions"],
        "symbol": SYMBOL.pattern,
    }


def _look(name: str) -> dict[str, Any]:
    """The label of a map without its light, the unit and range of its error, and its metric."""
    kind, metric = maps.KINDS[name.partition("/")[0]], METRICS_OF.get(name.partition("/")[0])
    return {"label": kind.label, "unit": kind.error_to, "range": kind.error_range, "metric": metric}


def selectable(summary: Summary) -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Groups by which cells can be selected: name, heading, and values with their texts; only with several values."""
    groups = [
        ("scene", "Scenes", [(scene, marked(summary, scene)) for scene in summary["scenes"]]),
        ("seed", "Seeds", [(str(seed), str(seed)) for seed in summary["seeds"]]),
        ("row", "Rows", [(row["key"], row["text"]) for row in summary["rows"]]),
    ]
    return [group for group in groups if len(group[2]) > 1]


def downloads(summary: Summary) -> list[tuple[str, str]]:
    """Names of files beside the page, with what they are."""
    suite = summary["suite"]
    return [
        (f"{suite}.csv", "table as CSV"),
        (f"{suite}.md", "table as Markdown"),
        (f"{suite}.tex", "table as LaTeX"),
        ("report.tex", "all tables and figures as LaTeX"),
        ("summary.json", "all values"),
    ]
