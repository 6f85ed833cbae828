"""Scenes for measuring kernels: surfels, and rays from them.

S   a sphere above a plane, 4,096 surfels, 2^14 rays from their visible sides
M   100,000 surfels over a closed blob with deep hollows, 2^18 rays outwards: 42 % hit something, 5 hits per ray
Mi  the blob of scene M seen from inside: every ray hits something, 15 hits per ray

and, from a file of points, real geometry of uneven density.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from radiogs_core.errors import DataError
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.transport.sampling import tangent_frame

OVERLAP = 0.93
"""Standard deviations over the spacing of M's surfels; this value gives the hits per ray stated above."""

SPREAD = 0.4
"""Standard deviation of the logarithm of each surfel's two scales."""

POINTS_MEASURED = 8
"""Neighbours from which a point's normal and scale are estimated."""

FEATURES = 8
"""Channels that radiometric consistency blends along a ray: normal, albedo, roughness and one more."""


@dataclass(frozen=True)
class KernelScene:
    """Surfels, and rays that start on them."""

    name: str
    geometry: SplatGeometry
    sh: Float[Tensor, "surfels 16 3"]
    """Harmonics of the surfels' radiance."""
    features: Float[Tensor, "surfels channels"]
    origin: Float[Tensor, "rays 3"]
    """Origins of the rays in the world."""
    direction: Float[Tensor, "rays 3"]
    """Unit directions of travel in the world."""
    t_min: Float[Tensor, " rays"]
    """Distance beyond which rays hit surfels, world units."""


def sphere_and_plane() -> KernelScene:
    """Scene S."""
    generator = torch.Generator().manual_seed(0)
    half = 2048
    ball = _spread_over_sphere(half)
    plane = 4 * torch.rand(half, 3, generator=generator, dtype=torch.float64) - 2
    plane[:, 2] = -1.05 + 0.02 * torch.randn(half, generator=generator, dtype=torch.float64)
    upwards = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64).expand(half, 3)
    return _scene("S", torch.cat([ball, plane]), torch.cat([ball, upwards]), _spacing(half), 1 << 14, generator)


def blob(inside: bool, count: int = 100_000, rays: int = 1 << 18) -> KernelScene:
    """Scene M, or Mi from inside; or the same blob under another number of surfels, with another number of rays."""
    generator = torch.Generator().manual_seed(0)
    towards = _spread_over_sphere(count)
    centre = (towards * _blob_radius(towards)[:, None]).requires_grad_()
    # The surface is |p| = r(p / |p|); its normal is the gradient of the difference.
    length = centre.norm(dim=-1)
    (slope,) = torch.autograd.grad((length - _blob_radius(centre / length[:, None])).sum(), centre)
    normal = torch.nn.functional.normalize(slope, dim=-1) * (-1 if inside else 1)
    return _scene("Mi" if inside else "M", centre.detach(), normal, _spacing(count), rays, generator)


def cloud(path: Path) -> KernelScene:
    """Surfels on the points ``means3d`` [points, 3] of an .npz, as gsplat's; normals upwards. Raises DataError."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            points = np.asarray(archive["means3d"], np.float64)
    except (OSError, EOFError, ValueError, KeyError, BadZipFile) as error:
        raise DataError(
            f"cannot read points from {path}",
            f"NumPy says: {error}.",
            "Give an .npz file with an array 'means3d' of shape [points, 3].",
        ) from error
    distance, neighbours = cKDTree(points).query(points, POINTS_MEASURED + 1)
    offsets = points[neighbours[:, 1:]] - points[:, None]
    normal = torch.from_numpy(np.linalg.svd(offsets, full_matrices=False)[2][:, -1])
    normal = torch.where(normal[:, 2:] < 0, -normal, normal)
    spacing = torch.from_numpy(distance[:, 1:].mean(1).clip(min=1e-6 * np.ptp(points)))
    generator = torch.Generator().manual_seed(0)
    return _scene(path.stem, torch.from_numpy(points), normal, spacing, 1 << 18, generator)


SCENES: dict[str, Callable[[], KernelScene]] = {
    "S": sphere_and_plane,
    "M": lambda: blob(inside=False),
    "Mi": lambda: blob(inside=True),
}


def _scene(
    name: str,
    centre: Float[Tensor, "surfels 3"],
    normal: Float[Tensor, "surfels 3"],
    spacing: float | Float[Tensor, " surfels"],
    rays: int,
    generator: torch.Generator,
) -> KernelScene:
    count = len(centre)
    frame = tangent_frame(normal)
    noise = torch.randn(count, 2, generator=generator, dtype=torch.float64)
    scale = OVERLAP * torch.as_tensor(spacing).reshape(-1, 1) * (SPREAD * noise).exp()
    opacity = 0.5 + 0.49 * torch.rand(count, generator=generator, dtype=torch.float64)
    geometry = SplatGeometry(
        *(
            value.float().contiguous()
            for value in (centre, frame[..., 0] / scale[:, :1], frame[..., 1] / scale[:, 1:], normal, opacity)
        )
    )
    sh = 0.3 * torch.randn(count, 16, 3, generator=generator)
    features = torch.rand(count, FEATURES, generator=generator)
    start = torch.randint(0, count, (rays,), generator=generator)
    direction = torch.nn.functional.normalize(torch.randn(rays, 3, generator=generator, dtype=torch.float64), dim=-1)
    below = (direction * normal[start]).sum(-1, keepdim=True) < 0
    direction = torch.where(below, -direction, direction).float()
    nearest = 3 * scale[start].amax(-1).float()
    return KernelScene(name, geometry, sh, features, geometry.centre[start], direction, nearest)


def _spread_over_sphere(count: int) -> Float[Tensor, "count 3"]:
    index = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * index / count
    azimuth = index * math.pi * (3 - math.sqrt(5))
    across = (1 - z * z).sqrt()
    return torch.stack([across * azimuth.cos(), across * azimuth.sin(), z], -1)


def _spacing(count: int) -> float:
    return math.sqrt(4 * math.pi / count)


def _blob_radius(towards: Float[Tensor, "count 3"]) -> Float[Tensor, " count"]:
    x, y, z = towards.unbind(-1)
    coarse = torch.sin(6.5 * x + 1) * torch.sin(6.5 * y) * torch.cos(6.5 * z)
    fine = torch.sin(13 * x) * torch.sin(11.05 * z + 1) * torch.cos(11.7 * y)
    return 1 + 0.45 * coarse + 0.225 * fine
