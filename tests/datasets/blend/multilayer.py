"""Files as Cycles writes them, with passes of known values."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import OpenEXR

from radiogs_datasets.blend.in_blender.features import FEATURES

COLOURS = (
    "Diffuse Direct", "Diffuse Indirect", "Diffuse Color", "Glossy Direct", "Glossy Indirect", "Glossy Color",
    "Transmission Direct", "Transmission Indirect", "Transmission Color", "Volume Direct", "Volume Indirect",
    "Emission",
)  # fmt: skip


def passes(size: int = 4, coverage: float = 1.0, **given: object) -> dict[str, np.ndarray]:
    """All passes of a grey surface that reflects a tenth indirectly; ``given`` replaces some (``_`` for a space)."""
    made = {name: np.zeros((size, size, 3)) for name in COLOURS}
    made |= {name: np.zeros((size, size, 1)) for name in FEATURES}
    made |= {
        "Diffuse Direct": np.full((size, size, 3), 0.9),
        "Diffuse Indirect": np.full((size, size, 3), 0.1),
        "Diffuse Color": np.full((size, size, 3), 0.5 * coverage),
        "Normal": np.tile([0.0, 0.0, coverage], (size, size, 1)),
        "albedo": np.tile([0.5 * coverage] * 3 + [coverage], (size, size, 1)),
        "roughness": np.full((size, size, 1), 0.4 * coverage),
        "depth": np.full((size, size, 1), 3.0 * coverage),
        "known": np.full((size, size, 1), coverage),
        "Combined": np.tile([0.5 * coverage] * 3 + [coverage], (size, size, 1)),
    }
    made |= {name.replace("_", " "): np.asarray(value, float) for name, value in given.items()}
    return {name: value.astype(np.float32) for name, value in made.items()}


def write_multilayer(path: Path, content: Mapping[str, np.ndarray]) -> None:
    """One part a pass, as Blender writes them: R, G, B(, A), normals X, Y, Z, and X for one value."""
    parts = []
    for name, value in content.items():
        letters = {1: "X", 3: "XYZ" if name == "Normal" else "RGB", 4: "RGBA"}[value.shape[2]]
        channels = {
            f"layer.{name}.{letter}": np.ascontiguousarray(value[..., place]) for place, letter in enumerate(letters)
        }
        header = {"name": f"layer.{name}", "compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        parts.append(OpenEXR.Part(header, channels, name=f"layer.{name}"))
    OpenEXR.File(parts).write(str(path))
