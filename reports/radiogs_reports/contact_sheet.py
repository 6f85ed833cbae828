"""One picture of a run: what was rendered and recovered beside the ground truth, a band for each row of the table."""

from pathlib import Path

import numpy as np
from matplotlib import colormaps, get_data_path
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from .summary import SheetSummary, Summary

SMALLEST_TILE = 192
GAP = 6
LABEL = 26
TITLE = 34
MARGIN = 14
PAPER, INK, FAINT = (250, 250, 248), (25, 25, 28), (110, 110, 116)
INDIRECT_GAIN = 4.0
"""Indirect light is shown four times brighter, or it would be too dark to judge."""

ERROR_RANGE = 0.25
"""Mean absolute difference over the channels, in display units, that has the brightest colour."""

Tile = tuple[str, NDArray[np.floating]]


def write_contact_sheet(summary: Summary, out: Path) -> Path:
    """Write ``contact_sheet.png`` into ``out``; returns its path."""
    bands = [_band(summary, entry, out) for entry in summary["sheet"]]
    sheet = Image.new("RGB", (max(band.width for band in bands), sum(band.height for band in bands)), PAPER)
    top = 0
    for band in bands:
        sheet.paste(band, (0, top))
        top += band.height
    path = out / "contact_sheet.png"
    sheet.save(path, optimize=True)
    return path


def _band(summary: Summary, entry: SheetSummary, out: Path) -> Image.Image:
    with np.load(out / entry["arrays"]) as archive:
        arrays = {name: archive[name].astype(np.float64) for name in archive.files}
    truth, render = _tiles(arrays, entry.get("light", ""))
    height, width = truth[0][1].shape[:2]
    factor = max(1, -(-SMALLEST_TILE // max(height, width)))
    step = width * factor + GAP
    band = Image.new(
        "RGB",
        (2 * MARGIN + max(len(truth), len(render)) * step, MARGIN + TITLE + 2 * (LABEL + height * factor + GAP)),
        PAPER,
    )
    draw = ImageDraw.Draw(band)
    draw.text((MARGIN, MARGIN), _title(summary, entry), fill=INK, font=_font(15))
    for line, tiles in enumerate((truth, render)):
        top = MARGIN + TITLE + line * (LABEL + height * factor + GAP)
        for place, (label, image) in enumerate(tiles):
            left = MARGIN + place * step
            draw.text((left, top + 5), label, fill=FAINT, font=_font(14))
            band.paste(_enlarged(image, factor), (left, top + LABEL))
    return band


def _tiles(arrays: dict[str, NDArray[np.float64]], light: str) -> tuple[list[Tile], list[Tile]]:
    """The upper line (ground truth) and the lower (rendered and recovered), column by column."""
    truth: list[Tile] = []
    render: list[Tile] = []
    columns = {
        "image": ("image", _as_is),
        "albedo": ("albedo (as sRGB)", _display),
        "normal": ("normal", _normal),
        "roughness": ("roughness", _as_is),
        "indirect": (f"indirect light x {INDIRECT_GAIN:g}", lambda image: _display(INDIRECT_GAIN * image)),
        "relit": (f"relit: {light}" if light else "relit", _as_is),
    }
    for name, (label, shown) in columns.items():
        if f"render/{name}" not in arrays:
            continue
        mine = shown(arrays[f"render/{name}"])
        theirs = arrays.get(f"truth/{name}")
        truth.append((f"true {label}", shown(theirs) if theirs is not None else np.full_like(mine, 0.9)))
        render.append((label, mine))
        if name == "image" and theirs is not None:
            scale = np.linspace(0, 1, mine.shape[1])[None, :, None].repeat(mine.shape[0], 0)
            truth.append((f"error scale: 0 to {ERROR_RANGE:g}", _false_colour(scale)))
            error = np.abs(mine - shown(theirs)).mean(-1, keepdims=True)
            render.append(("error of the image", _false_colour(error / ERROR_RANGE)))
    return truth, render


def _title(summary: Summary, entry: SheetSummary) -> str:
    row = next(row for row in summary["rows"] if row["key"] == entry["row"])
    figures = []
    for column in summary["columns"]:
        mean = summary["cells"][entry["row"]][column["key"]]["mean"]
        if mean is not None and column["unit"] in ("dB", "degrees", "°", "deg"):
            figures.append(f"{column['label']} {mean:.{column['decimals']}f} {column['unit']}")
    return f"{row['text']}   {entry['scene']}, {entry['view']}   table means: {', '.join(figures)}"


def _font(size: int) -> ImageFont.FreeTypeFont:
    """The font that comes with matplotlib: it has the Greek letters of the rows' names, on every machine."""
    return ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)


def _as_is(image: NDArray) -> NDArray:
    return image


def _display(linear: NDArray) -> NDArray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def _normal(image: NDArray) -> NDArray:
    return np.where((image == 0).all(-1, keepdims=True), 0, image * 0.5 + 0.5)


def _false_colour(values: NDArray) -> NDArray:
    return colormaps["inferno"](np.clip(values[..., 0], 0, 1))[..., :3]


def _enlarged(image: NDArray, factor: int) -> Image.Image:
    levels = np.rint(np.clip(image, 0, 1) * 255).astype(np.uint8)
    levels = levels.repeat(3, -1) if levels.shape[2] == 1 else levels[..., :3]
    return Image.fromarray(levels.repeat(factor, 0).repeat(factor, 1))
