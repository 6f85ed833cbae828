"""A run's maps in one figure: a band for each row of the table, and the ground truth of a view above its rows."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from radiogs_core.own_files import fresh

from .. import maps
from ..maps import ERROR_RANGE, KINDS, difference, false_colour
from ..summary import SheetSummary, Summary

SMALLEST_TILE, LARGEST_TILE = 192, 512
"""Bounds of a map's longer side in the sheet, in pixels: smaller maps are enlarged, larger ones averaged."""
GAP = 6
LABEL = 26
TITLE = 34
MARGIN = 14
PAPER, INK, FAINT = (250, 250, 248), (25, 25, 28), (110, 110, 116)
FONT = str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf")
"""Matplotlib's own font: it has the Greek letters of rows' names and is there on every machine."""

Tile = tuple[str, maps.Image]
Band = tuple[str, Mapping[str, maps.Image], str]
"""Title of a view, its maps by name (``SheetSummary``), and the light of its relit map, or an empty name."""


def write_contact_sheet(summary: Summary, out: Path) -> Path:
    """Write ``contact_sheet.png`` into ``out``; returns its path."""
    return write_bands(out, (_band_of(summary, entry, out) for entry in summary["sheet"]))


def write_bands(out: Path, bands: Iterable[Band]) -> Path:
    """Write these bands below each other as ``contact_sheet.png`` into ``out``; returns its path."""
    drawn: list[Image.Image] = []
    above: list[tuple[str, bytes]] = []
    for title, arrays, light in bands:
        truth, render = _tiles(arrays, light)
        looks = [(label, image.tobytes()) for label, image in truth]
        drawn.append(_drawn(title, [render] if looks in ([], above) else [truth, render]))
        above = looks
    sheet = Image.new("RGB", (max(band.width for band in drawn), sum(band.height for band in drawn)), PAPER)
    top = 0
    for band in drawn:
        sheet.paste(band, (0, top))
        top += band.height
    path = fresh(out / "contact_sheet.png", out)
    sheet.save(path, optimize=True)
    return path


def _drawn(title: str, lines: list[list[Tile]]) -> Image.Image:
    width, height = _fitted(lines[0][0][1]).size
    step, line_height = width + GAP, LABEL + height + GAP
    size = (2 * MARGIN + max(map(len, lines)) * step, MARGIN + TITLE + len(lines) * line_height)
    band = Image.new("RGB", size, PAPER)
    draw, small = ImageDraw.Draw(band), ImageFont.truetype(FONT, 14)
    draw.text((MARGIN, MARGIN), title, fill=INK, font=ImageFont.truetype(FONT, 15))
    for line, tiles in enumerate(lines):
        top = MARGIN + TITLE + line * line_height
        for place, (label, image) in enumerate(tiles):
            left = MARGIN + place * step
            draw.text((left, top + 5), label, fill=FAINT, font=small)
            band.paste(_fitted(image), (left, top + LABEL))
    return band


def _fitted(image: maps.Image) -> Image.Image:
    tile = Image.fromarray(maps.levels(image))
    longer = max(tile.size)
    if longer > LARGEST_TILE:
        return tile.reduce(-(-longer // LARGEST_TILE))
    factor = -(-SMALLEST_TILE // longer)
    return tile.resize((tile.width * factor, tile.height * factor), Image.Resampling.NEAREST)


def _tiles(arrays: Mapping[str, maps.Image], light: str) -> tuple[list[Tile], list[Tile]]:
    """Labelled tiles of the upper line (ground truth) and of the lower (rendered and recovered).

    If only the image has a truth (photos), the truth comes first in the lower line, and there is no upper line.
    """
    truth: list[Tile] = []
    render: list[Tile] = []
    for name, kind in KINDS.items():
        if f"render/{name}" not in arrays:
            continue
        label = f"relit: {light}" if name == "relit" and light else kind.label
        mine = kind.shown(arrays[f"render/{name}"])
        theirs = arrays.get(f"truth/{name}")
        if theirs is None:
            truth.append(("no truth", np.full_like(mine, 0.9)))
        else:
            truth.append((f"true {label}", kind.shown(theirs)))
        render.append((label, mine))
        if name == "image" and theirs is not None:
            scale = np.linspace(0, 1, mine.shape[1])[None, :, None].repeat(mine.shape[0], 0)
            truth.append((f"error scale: 0 to {ERROR_RANGE:g}", false_colour(scale)))
            render.append((f"image error, 0 to {ERROR_RANGE:g}", false_colour(difference(mine, theirs))))
    if [name for name in arrays if name.startswith("truth/")] == ["truth/image"]:
        return [], [truth[0], *render]
    return truth, render


def _band_of(summary: Summary, entry: SheetSummary, out: Path) -> Band:
    row = next(row for row in summary["rows"] if row["key"] == entry["row"])
    means = []
    for column in summary["columns"]:
        mean = summary["cells"][entry["row"]][column["key"]]["mean"]
        if mean is not None and column["unit"] in ("dB", "degrees", "°", "deg"):
            means.append(f"{column['label']} {mean:.{column['decimals']}f} {column['unit']}")
    title = f"{row['text']}   {entry['scene']}, {entry['view']}   table means: {', '.join(means)}"
    return title, maps.read_maps(out / entry["arrays"]), entry.get("light", "")
