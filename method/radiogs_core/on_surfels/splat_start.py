"""Surfels from a PLY file of splats, at which stage 1 may start.

3DGS, 2DGS and gsplat write the same properties, in different orders and with others between them: x, y, z; f_dc_0..2
and f_rest_* (harmonics of display sRGB minus 1/2; f_rest holds all of red first, then green and blue); opacity (a
logit); scale_* (natural logarithms; 2DGS has two); rot_0..3 (w, x, y, z, of any length). A surfel has the two largest
axes of an ellipsoid, and its smallest one as its normal.
"""

import hashlib
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from plyfile import PlyData, PlyParseError
from torch import Tensor
from torch.nn.functional import normalize

from ..errors import DataError
from ..scene.camera import Camera
from ..scene.colour import srgb_decode
from ..surfels.harmonics import refitted_harmonics
from ..surfels.starting_points import SurfelStart
from ..surfels.stored_tensors import DEGREES
from ..surfels.surfels import Surfels, product, surfels_at
from ..transport.blending_weights import blending_weights

CENTRE, COLOUR, ROTATION = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
NEEDED = (*CENTRE, *COLOUR, *ROTATION, "opacity", "scale_0", "scale_1")
"""Properties that every file of splats has."""

WRITERS = "`train --start` reads the .ply files of 3DGS, 2DGS and gsplat; convert another file, such as .spz, to one."

SMALLEST_TO_NORMAL = ((0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, -0.5), (1.0, 0.0, 0.0, 0.0))
"""Rotations (w, x, y, z) that take Z to axis k and X, Y to the two axes that follow it in the circle x, y, z."""

LEAST_SEEN = 0.25
"""Least share of the splats that training views have to see. Views see most splats of a model of their own scene."""

TURNED_OVER = (0.0, 1.0, 0.0, 0.0)
"""Half a turn about t_u, which swaps the sides of a surfel."""


def splat_surfels(start: SurfelStart, cameras: Sequence[Camera], linear: bool) -> Surfels:
    """The splats of ``start.splat`` as surfels on the CPU, with the initial materials of ``start``.

    Their front sides face the cameras that see them. ``linear``: their radiance is converted to linear RGB; else it
    stays display sRGB. Raises DataError for a file that has changed, holds no splats, or holds
    hardly any that a camera sees.
    """
    path = Path(start.splat)
    surfels = read_splats(path, start.splat_sha256)
    if linear:
        surfels.sh = refitted_harmonics(surfels.sh, srgb_decode)
    direction = torch.zeros_like(surfels.centre)
    for camera in cameras:  # splats have two sides, and surfels are seen from the front alone
        towards = normalize(camera.centre.to(surfels.centre) - surfels.centre, dim=-1)
        direction += blending_weights(camera, facing(surfels, towards))[:, None] * towards
    seen = int((direction != 0).any(-1).sum())
    if seen < LEAST_SEEN * len(surfels):
        raise DataError(
            f"the training views see {seen} of the {len(surfels)} splats of {path}",
            f"They lie about {_triple(surfels.centre.median(0).values)}, and the first camera at"
            f" {_triple(cameras[0].centre)}: the world of the file is not that of the scene.",
            "Train the splats with the same poses as the scene has, or move and scale them into its world.",
        )
    return facing(surfels, direction).with_material(start.albedo, start.roughness)


def facing(surfels: Surfels, direction: Float[Tensor, "surfels 3"]) -> Surfels:
    """The surfels, turned over where their normal is more than 90 degrees from ``direction``, world."""
    away = (direction * surfels.frame[..., 2]).sum(-1, keepdim=True) < 0
    over = product(surfels.rotation, torch.tensor(TURNED_OVER).expand_as(surfels.rotation))
    return replace(surfels, rotation=torch.where(away, over, surfels.rotation))


def read_splats(path: Path, sha256: str) -> Surfels:
    """The splats of a PLY file as surfels: display-sRGB radiance, normals of either sign, materials not set.

    Raises DataError for a file of another SHA-256, and for one without splats or with some that cannot be.
    """
    columns = _columns(path, sha256)
    rest, axes = sum(name.startswith("f_rest_") for name in columns), 2 + ("scale_2" in columns)
    coefficients = 1 + rest // 3
    if rest % 3 or coefficients not in DEGREES:
        raise DataError(
            f"{path} holds splats with {rest} properties f_rest_*",
            "Harmonics of degree 0, 1, 2 and 3 have 0, 9, 24 and 45 of them.",
            "Train or export the splats with a degree of at most 3.",
        )

    def stacked(*names: str) -> Tensor:
        return torch.from_numpy(np.stack([columns[name] for name in names], -1))

    scale, rotation = stacked(*(f"scale_{axis}" for axis in range(axes))), stacked(*ROTATION)
    broken = {name: int((~np.isfinite(values)).sum()) for name, values in columns.items()}
    broken |= {"scale_*": int((~scale.exp().isfinite()).sum()), "rot_*": int((rotation.norm(dim=-1) == 0).sum())}
    if any(broken.values()):
        name, count = max(broken.items(), key=lambda each: each[1])
        raise DataError(
            f"{path} holds {count} values of {name} that are no splat's, of {len(rotation)} splats",
            "They are NaN, infinite, or a rotation of length zero: no image shows such a splat.",
            "Remove these splats (viewers such as SuperSplat can), or train them again.",
        )
    centre = stacked(*CENTRE)
    surfels = surfels_at(centre, torch.ones(len(centre)), centre, torch.Generator().manual_seed(0))
    surfels.rotation, surfels.log_scale = _flattened(normalize(rotation, dim=-1), scale)
    surfels.opacity_logit = torch.from_numpy(columns["opacity"])
    surfels.sh[:, 0] = stacked(*COLOUR)
    if rest:
        channels = stacked(*(f"f_rest_{index}" for index in range(rest))).view(len(centre), 3, coefficients - 1)
        surfels.sh[:, 1:coefficients] = channels.transpose(1, 2)
    return surfels


def _columns(path: Path, sha256: str) -> dict[str, np.ndarray]:
    """The properties of splats by name, float32 [splats]; further properties are left out. Raises DataError."""
    try:
        data = path.read_bytes()
        if hashlib.sha256(data).hexdigest() != sha256:
            raise DataError(
                f"{path} has changed since `train --start` was given it",
                f"Its SHA-256 was {sha256[:12]}...",
                "Put the old file back, or give --start again.",
            )
        elements = {each.name: each.data for each in PlyData.read(io.BytesIO(data), mmap=False)}
        there = elements["vertex"].dtype.names if "vertex" in elements else ()
        if missing := [name for name in NEEDED if name not in there]:
            held = "; ".join(f"{name}: {', '.join(data.dtype.names)}" for name, data in elements.items())
            raise DataError(f"{path} holds no splats: it has {held:.300}", f"It lacks {', '.join(missing)}.", WRITERS)
        rest = sum(name.startswith("f_rest_") for name in there)
        names = [*NEEDED, *({"scale_2"} & {*there}), *(f"f_rest_{index}" for index in range(rest))]
        columns = {name: np.asarray(elements["vertex"][name], np.float64).astype(np.float32) for name in names}
    except (PlyParseError, ValueError, TypeError, OSError, MemoryError, EOFError) as error:
        raise DataError(f"cannot read {path}: {error}", "It is no complete PLY file of splats.", WRITERS) from error
    if len(columns["x"]) == 0:
        raise DataError(
            f"{path} holds no splats: its element 'vertex' is empty", "Training has to start from some.", WRITERS
        )
    return columns


def _flattened(
    rotation: Float[Tensor, "splats 4"], scale: Float[Tensor, "splats axes"]
) -> tuple[Float[Tensor, "splats 4"], Float[Tensor, "splats 2"]]:
    """Rotations and the two larger log-scales of ellipsoids without their smallest axis, which becomes the normal."""
    if scale.shape[1] == 2:
        return rotation, scale
    smallest = scale.argmin(-1)
    following = torch.stack([(smallest + 1) % 3, (smallest + 2) % 3], -1)
    return product(rotation, torch.tensor(SMALLEST_TO_NORMAL)[smallest]), scale.gather(1, following)


def _triple(point: Float[Tensor, "3"]) -> str:
    return "({:.3g}, {:.3g}, {:.3g})".format(*point.tolist())
