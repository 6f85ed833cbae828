"""Turning a stored map into numbers: the right part, colour space and ground."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from radiogs.colour import srgb_decode
from radiogs.errors import DataError
from radiogs.scene import View
from radiogs_datasets.image_files import read_image

from .files import Found

AS_NUMBERS = (".exr", ".npy")
"""Files whose normals and radiance are stored as they are, not encoded for display."""


def read_map(found: Found, view: View, coverage: Float[Tensor, "height width 1"]) -> Float[Tensor, "height width _"]:
    """The map as it appears on black, in the units of ``radiogs.scene.MapName`` (normals in the world).

    ``coverage`` is the true one: it takes the white of the ground away and multiplies straight colours; a file with
    an alpha of its own is multiplied by that instead. Raises DataError for a damaged file, one of another size than
    the view, or one with too few channels.
    """
    rule, size = found.rule, (view.camera.height, view.camera.width)
    stored = _part(found, _read(found.path), size)
    channels = 1 if rule.encoding == "value" else 3
    if stored.shape[2] < channels and stored.shape[2] != 1:
        raise DataError(f"{found.path} has {stored.shape[2]} channels, {channels} are needed")
    alpha = stored[..., 3:] if stored.shape[2] == 4 else coverage
    values = stored[..., :channels].expand(-1, -1, channels)
    if rule.ground == "white":
        values = (values - (1 - alpha)).clamp(min=0)
    numbers = found.path.suffix in AS_NUMBERS
    if rule.encoding == "normal":
        return _normals(values if numbers else 2 * values - 1, coverage)
    if rule.ground == "straight" or (stored.shape[2] == 4 and rule.ground == "black"):
        values = values * alpha
    if rule.encoding == "srgb" or (rule.encoding == "radiance" and not numbers):
        return srgb_decode(values)
    return values.clamp(min=0) ** 2.2 if rule.encoding == "gamma 2.2" else values


def _normals(directions: Tensor, coverage: Tensor) -> Tensor:
    """Unit directions times the true coverage; zero where the file has none."""
    return torch.nn.functional.normalize(directions, dim=-1) * coverage


def _part(found: Found, image: NDArray[np.float32], size: tuple[int, int]) -> Tensor:
    place, parts = found.rule.part
    height, width = image.shape[:2]
    if (height, width) != (size[0], parts * size[1]):
        raise DataError(
            f"{found.path} is {width} x {height} pixels",
            f"The scene's view is {size[1]} x {size[0]}"
            + (f", and {parts} images stand side by side in this file." if parts > 1 else "."),
            "Score results of the scene's resolution: a resized image is another image.",
        )
    return torch.from_numpy(image[:, place * size[1] : (place + 1) * size[1]].copy())


def _read(path: Path) -> NDArray[np.float32]:
    if path.suffix != ".npy":
        return read_image(path)
    try:
        values = np.load(path, allow_pickle=False)
    except (OSError, EOFError, ValueError) as error:
        raise DataError(f"cannot read {path}", f"NumPy says: {error}.", "Write it anew with numpy.save.") from error
    if not np.issubdtype(values.dtype, np.floating) or values.ndim not in (2, 3) or not np.isfinite(values).all():
        raise DataError(
            f"{path} is no image",
            f"It holds {values.dtype} of shape {values.shape}; finite floats [height, width(, channels)] are needed.",
        )
    return np.atleast_3d(values).astype(np.float32)
