"""The passes that Cycles writes for a picture, by name, and the maps that are computed from them."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from radiogs_core.errors import DataError

from .in_blender.features import FEATURES

OLD_NAMES = {
    "Emit": "Emission", "DiffDir": "Diffuse Direct", "DiffInd": "Diffuse Indirect", "DiffCol": "Diffuse Color",
    "GlossDir": "Glossy Direct", "GlossInd": "Glossy Indirect", "GlossCol": "Glossy Color",
    "TransDir": "Transmission Direct", "TransInd": "Transmission Indirect", "TransCol": "Transmission Color",
    "VolumeDir": "Volume Direct", "VolumeInd": "Volume Indirect",
}  # fmt: skip
"""Names of passes before Blender 5.0."""

LOBES = ("Diffuse", "Glossy", "Transmission")
COMPONENTS = {name: place for names in ("RGBA", "XYZ", "V") for place, name in enumerate(names)}

Map = NDArray[np.float32]


@dataclass(frozen=True)
class Maps:
    """The maps of one picture, [height, width, channels].

    Light is linear RGB and multiplied by alpha; the other maps are straight.
    """

    image: Map
    """Outgoing radiance."""
    alpha: Map
    """Coverage in [0, 1]."""
    direct: Map
    """Radiance after one surface, and emitted radiance."""
    indirect: Map
    """Radiance after two or more surfaces."""
    incident_indirect: Map
    """Indirect irradiance over pi: cosine-weighted mean of incident indirect radiance; zero if nothing is diffuse."""
    albedo: Map
    """Diffuse albedo, linear RGB."""
    normal: Map
    """Unit normals in the world."""
    roughness: Map | None
    """Perceptual roughness; None if a material could not be evaluated."""
    depth: Map
    """z-depth, world units."""
    features: Mapping[str, Map]
    """Share of each pixel that has a feature of materials, by feature."""
    closure: float
    """Largest difference of ``image`` from ``direct`` + ``indirect``."""


def read_passes(path: Path) -> dict[str, Map]:
    """The passes of a multi-layer file by their names since Blender 5.0. Raises DataError for a damaged file."""
    parts: dict[str, dict[int, Map]] = defaultdict(dict)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            for part in file.parts:
                for name, channel in part.channels.items():
                    layer, _, component = name.rpartition(".")
                    kind = layer.partition(".")[2]
                    parts[OLD_NAMES.get(kind, kind)][COMPONENTS[component]] = np.asarray(channel.pixels, np.float32)
    except (RuntimeError, ValueError, TypeError, KeyError, OSError) as error:
        raise DataError(
            f"{path} is not what Blender was asked to write", f"OpenEXR says: {error}.", "Run the command again."
        ) from error
    return {name: np.stack([held[place] for place in sorted(held)], -1) for name, held in parts.items()}


def maps_of(passes: Mapping[str, Map]) -> Maps:
    """The maps that are computed from the passes; see ``Maps``."""
    image, alpha = passes["Combined"][..., :3], passes["Combined"][..., 3:]
    direct, indirect = (
        sum((passes[f"{lobe} Color"] * passes[f"{lobe} {order}"] for lobe in LOBES), passes[f"Volume {order}"])
        for order in ("Direct", "Indirect")
    )
    direct = direct + passes["Emission"]
    known = _straight(passes["known"], alpha)
    normal = passes["Normal"]
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    there = alpha > 0
    return Maps(
        image=image,
        alpha=alpha,
        direct=np.where(there, direct, 0),
        indirect=np.where(there, indirect, 0),
        incident_indirect=np.where(there, passes["Diffuse Indirect"], 0),
        albedo=_straight(passes["albedo"][..., :3] + (1 - known) * passes["Diffuse Color"], alpha),
        normal=(normal / np.where(length > 0, length, 1)).astype(np.float32),
        roughness=_straight(passes["roughness"], alpha) if bool((known[there] > 0.999).all()) else None,
        depth=_straight(passes["depth"], alpha),
        features={name: np.clip(_straight(passes[name], alpha), 0, 1) for name in FEATURES},
        closure=float(np.abs(np.where(there, image - direct - indirect, 0)).max()),
    )


def _straight(value: Map, alpha: Map) -> Map:
    return np.where(alpha > 0, value / np.where(alpha > 0, alpha, 1), 0).astype(np.float32)
