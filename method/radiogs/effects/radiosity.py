"""Light that has met several surfaces, followed over surfels bounce by bounce: how much each further one adds."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, SPECULAR_DIRECT, shade_surfels
from radiogs_core.transport.tracer import SurfelTracer, visibility_of

OFFSET = 0.1
"""Where rays start, in standard deviations: on surfels that lie exactly on their surface little more than rounding is
in the way."""

BOUNCES = 8
"""Surfaces that light is followed over, as in the pictures of generated scenes."""


@dataclass(frozen=True)
class Decay:
    """Energy that arrives after one surface, after two, and so on: means over surfels and channels, linear."""

    energy: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Of the second to the first; 0 where nothing arrives."""
        return self.energy[1] / self.energy[0] if self.energy[0] > 0 else 0.0

    def needed(self, first: float, tolerated: float) -> int:
        """Bounces after which what is missing costs less than is tolerated; ``first``: what all but one of them add.

        Both are squared errors, which fall by the square of the ratio with every further bounce.
        """
        if first <= tolerated or self.ratio <= 0:
            return 1
        falling = math.log(min(self.ratio, 0.99) ** 2)
        return 1 + math.ceil(math.log(tolerated / first) / falling)


@torch.no_grad()
def solved(
    surfels: Surfels, light: EnvironmentMap, samples: int, seed: int, bounces: int = BOUNCES
) -> tuple[Surfels, Decay]:
    """The surfels with the radiance that they send out under a light, the same to all sides, and how it builds up."""
    normal = surfels.frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(seed))
    hits = SurfelTracer(surfels, OFFSET).trace(torch.arange(len(surfels)), direction, torch.zeros_like(surfels.albedo))
    lit = Incident(direction, weight, visibility_of(hits)[0].view(weight.shape), torch.zeros_like(direction))
    parts = shade_surfels(surfels, surfels.albedo, lit, normal[:, None], light.radiance)[:, 0]
    sent = parts[:, DIFFUSE_DIRECT] + parts[:, SPECULAR_DIRECT]
    total, decay = scattered(surfels, sent, direction, weight, bounces - 1)
    harmonics = torch.cat([radiance_to_sh(total)[:, None], torch.zeros_like(surfels.sh[:, 1:])], 1)
    return Surfels.of(surfels.parameters() | {"sh": harmonics}), decay


@torch.no_grad()
def scattered(
    surfels: Surfels,
    sent: Float[Tensor, "surfels 3"],
    direction: Float[Tensor, "surfels samples 3"],
    weight: Float[Tensor, "surfels samples"],
    times: int,
) -> tuple[Float[Tensor, "surfels 3"], Decay]:
    """Radiance after what is ``sent`` was scattered that many times, and the energy of each.

    Radiosity by Jacobi's iteration over traced rays; surfaces scatter by Lambert's law.
    """
    tracer, index = SurfelTracer(surfels, OFFSET), torch.arange(len(surfels))
    flow = (direction * surfels.frame[:, None, :, 2]).sum(-1, keepdim=True) * weight[..., None] / torch.pi
    total, energy = sent.clone(), []
    for _ in range(times):
        hits = tracer.trace(index, direction, sent)
        met = (hits.features * visibility_of(hits)[1][:, None]).view(direction.shape)
        sent = surfels.albedo * (flow * met).sum(1)
        energy.append(float(sent.mean()))
        total = total + sent
    return total, Decay(tuple(energy))
