"""Which channels of an OpenEXR file are its image: told by their names, and refused by name where they do not tell.

A channel is called ``layer.R``; renderers write ``R, G, B, A``, ``ViewLayer.Combined.R`` (Blender), ``Y`` or ``Z`` or
``V`` (one value), ``Normal.X, Normal.Y, Normal.Z``. Case does not matter. Taking channels by the order of their names
instead would turn RGB to BGR, and alpha to depth.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from radiogs_core.errors import DataError

COLOURS = (("R", "G", "B", "A"), ("R", "G", "B"), ("X", "Y", "Z"))
"""Names of the channels of a layer that make an image, in its order; the first set that is whole counts."""

VALUES = ("Y", "Z", "V")
"""Names of the one channel of a map of values: luminance, depth (Z), and Blender's value (V)."""

REC709 = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290))
REC709_AT_D50 = ((0.6484, 0.3309), (0.3212, 0.5979), (0.1559, 0.0661), (0.3457, 0.3585))
"""xy of red, green, blue and white: sRGB's, and the same adapted to D50 (as Adobe writes), whose RGB are the same."""

CHROMATICITY_TOLERANCE = 0.01


def chosen(path: Path, names: Iterable[str]) -> list[str]:
    """The names of the channels of the image, in the order R, G, B(, A). Raises DataError where they do not tell.

    Colours without a layer go before those of any layer; else there must be one layer with an image.
    """
    layers: dict[str, dict[str, str]] = {}
    for name in names:
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {})[channel.upper()] = name
    images = {layer: found for layer, held in layers.items() if (found := _image(held))}
    if len(images.get("", ())) > 1:
        return images[""]
    if len(images) == 1 and ("" in images or "" not in layers):
        return next(iter(images.values()))
    raise DataError(
        f"{path} has the channels {', '.join(sorted(names))[:300]}",
        "Which of them are the image is told by their names: R, G, B(, A), X, Y, Z, or one of Y, Z, V, in one layer.",
        "Save the one layer that is meant as an OpenEXR file of its own, with these names.",
    )


def _image(held: Mapping[str, str]) -> list[str]:
    """Of a layer's channels by their names in capitals those of its image; none where they make no image."""
    for names in COLOURS:
        if all(name in held for name in names):
            return [held[name] for name in names]
    rest = [name for name in held if name != "A"]
    if len(rest) == 1:
        # A layer of red alone is half an image where there is alpha, and a value where there is nothing else.
        return [] if "A" in held and rest[0] in "RGB" else [held[rest[0]]]
    values = [name for name in rest if name in VALUES]
    return [held[values[0]]] if len(values) == 1 and not {"R", "G", "B", "RY", "BY"} & set(rest) else []


def require_plain(path: Path, parts: list[str], header: Mapping[str, Any]) -> None:
    """Raises DataError for what changes an image and is not applied: parts, a cut window, other primaries."""
    if len(parts) > 1:
        raise _refused(path, f"has {len(parts)} parts: {', '.join(parts)[:300]}", "There is no telling which is meant.")
    data, display = (np.asarray(header[name]).tolist() for name in ("dataWindow", "displayWindow"))
    if data != display:
        raise _refused(
            path, f"holds the window {data} of an image {display}", "What lies outside is not there: it was cropped."
        )
    if abs(float(header.get("pixelAspectRatio", 1)) - 1) > CHROMATICITY_TOLERANCE:
        raise _refused(path, f"has pixels of the ratio {header['pixelAspectRatio']:g}", "Pixels are taken for square.")
    stored = header.get("chromaticities")
    if stored is not None:
        off = [float(np.abs(np.ravel(stored) - np.ravel(known)).max()) for known in (REC709, REC709_AT_D50)]
        if not min(off) <= CHROMATICITY_TOLERANCE:
            raise _refused(
                path,
                f"has other primaries than sRGB's: {', '.join(f'{value:.4g}' for value in np.ravel(stored))}",
                "Its numbers are no sRGB (Rec. 709) radiance.",
            )


def _refused(path: Path, what: str, why: str) -> DataError:
    return DataError(f"{path} {what}", why, "Save it as a single whole image with linear sRGB (Rec. 709) primaries.")
