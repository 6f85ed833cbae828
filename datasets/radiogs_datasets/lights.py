"""Environment maps from files: distant light as linear radiance."""

from pathlib import Path

import numpy as np
import torch

from radiogs_core.errors import DataError, UsageError
from radiogs_core.scene.light import EnvironmentMap

from .image_files import read_exr, read_hdr

OWN_LIGHTS = Path(__file__).parent / "tiny" / "corner" / "envmaps"
"""A folder of maps that comes with the package: a sunny sky (``training``), a sunset, an overcast sky."""


def read_light(path: Path) -> tuple[EnvironmentMap, list[str]]:
    """A map of distant light, Z up, from RGB or RGBA; negative radiance becomes zero, which the sentence returned says.

    Raises UsageError for a file of another kind than .hdr and .exr, DataError for a damaged one, for one of fewer
    channels, and for one in which nothing is above zero.
    """
    readers = {".hdr": read_hdr, ".exr": read_exr}
    if path.suffix.lower() not in readers:
        raise UsageError(f"{path} is neither .hdr nor .exr", "Light needs linear values above one.")
    image = readers[path.suffix.lower()](path)[..., :3]
    if image.shape[2] < 3:
        raise DataError(
            f"{path} has {image.shape[2]} channels, 3 are needed", "Light has a colour.", "Export it as RGB."
        )
    if not float(image.max()) > 0:
        raise DataError(f"{path} is dark: none of its radiance is above zero", "", "Export the light again.")
    negative = int((image < 0).sum())
    said = [f"{path.name}: {negative} negative values of radiance were set to zero"] if negative else []
    return EnvironmentMap(torch.from_numpy(np.ascontiguousarray(image)).clamp(min=0)), said
