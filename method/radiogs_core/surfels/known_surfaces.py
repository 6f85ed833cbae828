"""Surfels on a scene's true surfaces with its true materials: exact geometry, without reconstruction error."""

from dataclasses import dataclass

import torch
from scipy.spatial.transform import Rotation

from ..scene.surfaces import SurfaceSamples
from .harmonics import COEFFICIENTS
from .surfels import ROUGHNESS_FLOOR, Surfels, inverse_sigmoid

OPACITY = 0.99
"""Peak opacity of every surfel."""

OVERLAP = 0.65
"""Standard deviation of a surfel, in sides of its sample's cell. At most 2.7 % of a ray's light then passes inside a
face (where four cells meet), below the 3 % at which the tracer ends a ray. Wider surfels would blur: coplanar surfels
are sorted by their centres' distance from the camera, which shifts the image by about a third of a cell."""


@dataclass(frozen=True)
class KnownRadiance:
    """Surfels on the true surfaces with their outgoing radiance under the true light."""

    surfels: Surfels
    """The surfels; ``sh`` is the solved radiance."""
    residual: float
    """Mean |L_G - L_PBR| over mean L_PBR, towards directions that the solver did not use."""


def surfels_on(samples: SurfaceSamples) -> Surfels:
    """One nearly opaque surfel for each sample, with its albedo and roughness; radiance 1/2 in all channels; float32.

    Raises ValueError for an albedo outside (0, 1) or a roughness outside (ROUGHNESS_FLOOR, 1).
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
