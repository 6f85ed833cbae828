"""A run's maps in one figure: a band for each row of the table, and the ground truth of a view above its rows."""

from pathlib import Path

import numpy as np
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from radiogs_core.own_files import fresh

from .. import maps
from ..maps import ERROR_RANGE, KINDS, difference, false_colour
from ..summary import SheetSummary, Summary

SMALLEST_TILE = 192
GAP = 6
LABEL = 26
TITLE = 34
MARGIN = 14
PAPER, INK, FAINT = (250, 250, 248), (25, 25, 28), (110, 110, 116)
Tile = tuple[str, maps.Image]


def write_contact_sheet(summary: Summary, out: Path) -> Path:
    """Write ``contact_sheet.png`` into ``out``; returns its path."""
    bands: list[Image.Image] = []
    above: list[tuple[str, bytes]] = []
    for entry in summary["sheet"]:
        truth, render = _tiles(maps.read_maps(out / entry["arrays"]), entry.get("light", ""))
        looks = [(label, image.tobytes()) for label, image in truth]
        bands.append(_band(_title(summary, entry), [render] if looks == above else [truth, render]))
        above = looks
    sheet = Image.new("RGB", (max(band.width for band in bands), sum(band.height for band in bands)), PAPER)
    top = 0
    for band in bands:
        sheet.paste(band, (0, top))
        top += band.height
    path = fresh(out / "contact_sheet.png", out)
    sheet.save(path, optimize=True)
    return path


def _band(title: str, lines: list[list[Tile]]) -> Image.Image:
    height, width = lines[0][0][1].shape[:2]
    factor = max(1, -(-SMALLEST_TILE // max(height, width)))
    step, line_height = width * factor + GAP, LABEL + height * factor + GAP
    size = (2 * MARGIN + max(map(len, lines)) * step, MARGIN + TITLE + len(lines) * line_height)
    band = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(band)
    draw.text((MARGIN, MARGIN), title, fill=INK, font=_font(15))
    for line, tiles in enumerate(lines):
        top = MARGIN + TITLE + line * line_height
        for place, (label, image) in enumerate(tiles):
            left = MARGIN + place * step
            draw.text((left, top + 5), label, fill=FAINT, font=_font(14))
            enlarged = maps.levels(image).repeat(factor, 0).repeat(factor, 1)
            band.paste(Image.fromarray(enlarged), (left, top + LABEL))
    return band


def _tiles(arrays: dict[str, maps.Image], light: str) -> tuple[list[Tile], list[Tile]]:
    """Labelled tiles of the upper line (ground truth) and of the lower (rendered and recovered)."""
    truth: list[Tile] = []
    render: list[Tile] = []
    for name, kind in KINDS.items():
        if f"render/{name}" not in arrays:
            continue
        label = f"relit: {light}" if name == "relit" and light else kind.label
        mine = kind.shown(arrays[f"render/{name}"])
        theirs = arrays.get(f"truth/{name}")
        if theirs is None:
            truth.append((f"no true {kind.label}", np.full_like(mine, 0.9)))
        else:
            truth.append((f"true {label}", kind.shown(theirs)))
        render.append((label, mine))
        if name == "image" and theirs is not None:
            scale = np.linspace(0, 1, mine.shape[1])[None, :, None].repeat(mine.shape[0], 0)
            truth.append((f"error scale: 0 to {ERROR_RANGE:g}", false_colour(scale)))
            render.append(("error of the image", false_colour(difference(mine, theirs))))
    return truth, render


def _title(summary: Summary, entry: SheetSummary) -> str:
    row = next(row for row in summary["rows"] if row["key"] == entry["row"])
    means = []
    for column in summary["columns"]:
        mean = summary["cells"][entry["row"]][column["key"]]["mean"]
        if mean is not None and column["unit"] in ("dB", "degrees", "°", "deg"):
            means.append(f"{column['label']} {mean:.{column['decimals']}f} {column['unit']}")
    return f"{row['text']}   {entry['scene']}, {entry['view']}   table means: {', '.join(means)}"


def _font(size: int) -> ImageFont.FreeTypeFont:
    """Matplotlib's own font: it has the Greek letters of rows' names and is there on every machine."""
    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
