"""Surfels laid on surfaces that are known, with their true materials: geometry that no reconstruction has blurred."""

from dataclasses import dataclass

import torch
from scipy.spatial.transform import Rotation

from ..scene.surfaces import SurfaceSamples
from .harmonics import COEFFICIENTS
from .surfels import ROUGHNESS_FLOOR, Surfels, inverse_sigmoid

OPACITY = 0.99
OVERLAP = 0.65
"""Standard deviation in sizes of a sample's cell: inside a face less of a ray's light passes than a solid surface lets
through (2.7 %, where four cells meet). More would blur: of coplanar surfels the one whose centre is nearer to the
camera comes first, which moves what is seen by about a third of a cell."""


@dataclass(frozen=True)
class KnownRadiance:
    """Surfels on the true surfaces with the radiance that they send out under the true light.

    residual: mean |L_G - L_PBR| over mean L_PBR, from directions that were not used to find it.
    """

    surfels: Surfels
    residual: float


def surfels_on(samples: SurfaceSamples) -> Surfels:
    """One nearly opaque surfel for each sample, with its albedo and roughness; radiance grey 1/2. Float32.

    Raises ValueError for an albedo or roughness that no surfel has: those lie in (0, 1) and (ROUGHNESS_FLOOR, 1).
    """
    rough = (samples.roughness - ROUGHNESS_FLOOR) / (1 - ROUGHNESS_FLOOR)
    for name, value in (("albedo", samples.albedo), ("roughness", rough)):
        if not bool(((value > 0) & (value < 1)).all()):
            raise ValueError(f"surfels of this {name} have no finite parameters")
    count = len(samples)
    surfels = Surfels(
        centre=samples.centre,
        rotation=torch.from_numpy(Rotation.from_matrix(samples.frame.numpy()).as_quat(scalar_first=True)),
        log_scale=(OVERLAP * samples.size).log(),
        opacity_logit=torch.full((count,), inverse_sigmoid(OPACITY)),
        sh=torch.zeros(count, COEFFICIENTS, 3),
        albedo_logit=torch.logit(samples.albedo),
        roughness_logit=torch.logit(rough),
    )
    return Surfels.of({name: value.float().contiguous() for name, value in surfels.parameters().items()})
