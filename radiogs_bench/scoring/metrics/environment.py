"""Errors of a recovered environment map: of its texels, and of the irradiance and the reflections under it."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import UsageError
from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles

from .conventions import Environment

UNSCALED = Environment("none")
"""No alignment: the recovered light is compared unscaled."""

AT_ONCE = 512
"""Directions that are integrated at once: times the texels of 64 rows they are 32 MB in float64. With fewer,
synchronising threads on busy cores takes longer than the operations."""


def environment_error(
    estimate: Float[Tensor, "height width 3"], truth: Float[Tensor, "rows columns 3"], rules: Environment = UNSCALED
) -> float:
    """Squared error over the squared truth, both integrated over solid angle; 0 is exact, 1 a black estimate.

    Both maps are linear latitude-longitude radiance in one frame and size. With a scale the least-squares factor is
    applied first, because light is known only up to a factor per channel; the error is then 1 - cos^2 of the maps'
    angle and at most 1. NaN for a truth that is black. Raises UsageError for maps of different sizes.
    """
    if estimate.shape != truth.shape:
        raise UsageError(
            f"environment maps of {tuple(estimate.shape)} and {tuple(truth.shape)} cannot be compared",
            "Every texel needs its partner.",
            "Resample one of them first.",
        )
    ours, theirs = estimate.double().cpu(), truth.double().cpu()
    return relative_squared_error(ours.flatten(0, 1), theirs.flatten(0, 1), rules, _weight(theirs))


def relative_squared_error(
    estimate: Float[Tensor, "samples 3"],
    truth: Float[Tensor, "samples 3"],
    rules: Environment,
    weight: Float[Tensor, "samples 1"] | None = None,
) -> float:
    """Weighted squared errors over squared truths, after the rules' least-squares factor; NaN for a black truth."""
    each = torch.ones_like(truth[:, :1]) if weight is None else weight
    dimensions = (0,) if rules.scale == "factor a channel" else (0, 1)
    if rules.scale != "none":
        square = (each * estimate.square()).sum(dimensions)
        product = (each * estimate * truth).sum(dimensions)
        estimate = estimate * torch.where(square > 0, product / torch.where(square > 0, square, 1.0), 0.0)
    power = float((each * truth.square()).sum())
    return float((each * (estimate - truth).square()).sum()) / power if power > 0 else math.nan


def irradiance(
    radiance: Float[Tensor, "height width 3"], normals: Float[Tensor, "points 3"]
) -> Float[Tensor, "points 3"]:
    """Unshadowed irradiance of surfaces with unit normals, linear RGB; texels have their exact solid angles."""
    light, power = _towards(radiance), _weight(radiance) * radiance.flatten(0, 1)
    return torch.cat([(normal @ light.T).clamp_(min=0) @ power for normal in normals.split(AT_ONCE)])


def glossy_reflection(
    radiance: Float[Tensor, "height width 3"], mirrored: Float[Tensor, "points 3"], roughness: Float[Tensor, "points 1"]
) -> Float[Tensor, "points 3"]:
    """Mean radiance over the GGX lobe around unit mirror directions, linear RGB, in the type of the map.

    The lobe is isotropic as in split-sum shading: view and normal lie along the mirror direction, and the weight is
    D(h) (n.w) per solid angle, with alpha the square of the perceptual ``roughness``. A lobe that is narrower than a
    texel reads the nearest texel.
    """
    light, weight = _towards(radiance), _weight(radiance)
    power = torch.cat([weight * radiance.flatten(0, 1), weight], -1)
    found = []
    for axis, rough in zip(mirrored.split(AT_ONCE), roughness.split(AT_ONCE), strict=True):
        cosine, alpha_squared = axis @ light.T, rough**4
        # (n.h)^2 is (1 + n.w) / 2 here.
        denominator = torch.addcmul((alpha_squared + 1) / 2, cosine, (alpha_squared - 1) / 2)
        received = cosine.clamp_(min=0).div_(denominator.square_()) @ power
        found.append(received[:, :3] / received[:, 3:])
    return torch.cat(found)


def at_rows(light: EnvironmentMap, rows: int) -> Float[Tensor, "{rows} columns 3"]:
    """A light at ``rows`` and twice as many columns, float64 on the CPU: averaged if it is finer, else looked up."""
    radiance = light.radiance.double().cpu()
    if len(radiance) > rows:
        return averaged(radiance, rows, 2 * rows)
    return EnvironmentMap(radiance).lookup(texel_directions(rows, 2 * rows))


def averaged(radiance: Float[Tensor, "height width 3"], rows: int, columns: int) -> Float[Tensor, "{rows} {columns} 3"]:
    """Mean over the solid angle of each texel of another grid: the energy of the light stays the same."""
    bands = [-torch.cos(torch.linspace(0, torch.pi, 1 + count, dtype=torch.float64)) for count in (rows, len(radiance))]
    slices = [torch.linspace(0, 1, 1 + count, dtype=torch.float64) for count in (columns, radiance.shape[1])]
    # Two products: one of all three would build the outer product of the shares, 34 GB for 512 rows.
    banded = torch.tensordot(_shares(*bands), radiance.double(), 1)
    return _shares(*slices) @ banded


def _shares(to: Float[Tensor, " ends"], of: Float[Tensor, " edges"]) -> Float[Tensor, "intervals pieces"]:
    """For each interval between the edges ``to``, the share that each interval between the edges ``of`` fills."""
    lower, upper = torch.maximum(to[:-1, None], of[:-1]), torch.minimum(to[1:, None], of[1:])
    return (upper - lower).clamp(min=0) / to.diff()[:, None]


def _towards(radiance: Float[Tensor, "height width 3"]) -> Float[Tensor, "texels 3"]:
    return texel_directions(*radiance.shape[:2], dtype=radiance.dtype).flatten(0, 1)


def _weight(radiance: Float[Tensor, "height width 3"]) -> Float[Tensor, "texels 1"]:
    height, width = radiance.shape[:2]
    return texel_solid_angles(height, width, dtype=radiance.dtype).expand(height, width).reshape(-1, 1)
