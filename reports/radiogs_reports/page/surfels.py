"""The 3-D view of surfels: every cell's surfels packed for the page within a budget of bytes, and a page of one model.

A surfel takes 26 bytes, little-endian: its centre as three uint16 between the cell's lowest and highest coordinates,
its two tangents as six int16 in shares of the longest component, and as bytes its opacity, radiance and albedo (both
sRGB) and roughness. Relighting takes 128 more: bits for 512 directions, and 32 surfels that it meets, as uint16.
"""

import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radiogs_core.own_files import fresh

from .. import maps
from ..summary import RunSummary
from .assets import VIEWER, json_for_script, rendered, scripts, styles

BUDGET = 12 * 2**20
"""Bytes of the packed surfels of all cells, as text."""

PACKED = np.dtype(
    [
        ("centre", "<u2", 3),
        ("tangents", "<i2", 6),
        ("opacity", "u1"),
        ("radiance", "u1", 3),
        ("albedo", "u1", 3),
        ("roughness", "u1"),
    ]
)

Packed = dict[str, Any]
"""``low`` and ``step`` [3] of centres, ``reach`` of tangents, ``eye``, ``up`` and ``middle`` [3]: first position of the
viewer, upward direction, point looked at (None: the middle of the surfels), ``count`` of the whole model, ``surfels``
in base64; ``relit``, empty or in base64 ``seen``, ``met`` and ``light/<name>`` [32, 64, 3], float32."""

NOTHING_MET = 65535
"""Index of the met surfel for a ray that meets none."""


def packed_surfels(runs: list[RunSummary], out: Path, budget: int = BUDGET) -> dict[str, Packed]:
    """Packed surfels by cell key, first seeds first, of as many cells as the budget allows; then what relights them."""
    found: dict[str, Packed] = {}
    further: dict[str, Packed] = {}
    for run in sorted((run for run in runs if run["arrays"]), key=lambda run: run["seed"]):
        arrays = maps.read_maps(out / str(run["arrays"]), "surfels/")
        if not arrays:
            continue
        made = packed(arrays)
        further[run["key"]] = made.pop("relit")
        budget -= len(made["surfels"])
        if budget < 0:
            break
        found[run["key"]] = made
    for key, made in found.items():
        budget -= sum(map(len, further[key].values()))
        made["relit"] = further[key] if budget >= 0 else {}
    return found


def packed(arrays: dict[str, NDArray[np.float64]]) -> Packed:
    """The surfels of a cell's arrays."""
    centre, tangents = arrays["surfels/centre"], arrays["surfels/tangents"]
    low, high = centre.min(0), centre.max(0)
    step, reach = np.maximum(high - low, 1e-30) / 65535, max(np.abs(tangents).max(), 1e-30)
    surfels = np.zeros(len(centre), PACKED)
    surfels["centre"] = np.rint((centre - low) / step)
    surfels["tangents"] = np.rint(tangents.reshape(-1, 6) / reach * 32767)
    for name in ("opacity", "roughness", "radiance", "albedo"):
        shares = np.clip(arrays[f"surfels/{name}"], 0, 1)
        if name in ("radiance", "albedo"):
            shares = np.clip(maps.display(shares), 0, 1)
        surfels[name] = np.rint(shares * 255)
    binary = {name: values.astype("<f4") for name, values in arrays.items() if name.startswith("surfels/light/")}
    if "surfels/seen" in arrays:
        met = arrays["surfels/met"]
        binary["surfels/seen"] = arrays["surfels/seen"].astype("u1")
        binary["surfels/met"] = np.where(met < 0, NOTHING_MET, met).astype("<u2")
    texts = {name.removeprefix("surfels/"): base64.b64encode(each.tobytes()).decode() for name, each in binary.items()}
    return {
        "low": low.tolist(),
        "step": step.tolist(),
        "reach": float(reach),
        "eye": arrays["surfels/eye"].tolist(),
        "up": arrays["surfels/up"].tolist(),
        "middle": arrays["surfels/middle"].tolist() if "surfels/middle" in arrays else None,
        "count": int(arrays["surfels/count"][0]),
        "surfels": base64.b64encode(surfels.tobytes()).decode("ascii"),
        "relit": texts,
    }


SCRIPTS = ("shared", "theme", *VIEWER)
STYLES = ("page", "comparison")
MODEL = "model"


def write_viewer(arrays: dict[str, NDArray], title: str, path: Path) -> Path:
    """Write the page of a model's arrays (``surfels/...``, as cells keep them); returns its path. Raises OSError."""
    run = {"key": MODEL, "row": MODEL, "name": title}
    text = rendered(
        "viewer.html",
        scripts(SCRIPTS),
        styles(STYLES),
        title=title,
        surfels={MODEL: packed(arrays)},
        data=json_for_script({"rows": [{"key": MODEL, "text": title}], "runs": [run]}),
    )
    path = fresh(path, path.parent)
    path.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path
