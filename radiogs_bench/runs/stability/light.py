"""Axes of shading: width of the highlight, and radiance of the sun."""

import torch
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.kernels.shade.brdf import ggx_distribution
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.transport.sampling import hemisphere_directions, tangent_frame

from .curve import Axis, Kernel, Probe, Stand, Values
from .kernels import shaded

COUNT = 64
SPREAD, DRAWN = 16, 16
"""Directions per surfel: over its hemisphere, and drawn from the light."""


def highlight(roughness: float, stand: Stand) -> dict[str, Tensor]:
    """Surfels lit from near the mirror direction: the half-vector is up to four widths of the lobe off the normal."""
    generator = stand.generator()
    normal = normalize(torch.randn(COUNT, 3, generator=generator, dtype=torch.float64), dim=-1)
    tangent, bitangent, _ = tangent_frame(normal).unbind(-1)
    width = 4 * torch.rand(COUNT, 1, generator=generator).double() * roughness**2
    half = normalize(normal + width.clamp(max=0.5) * tangent, dim=-1)
    outgoing = normalize(half + torch.rand(COUNT, 1, generator=generator).double() * bitangent, dim=-1)
    incoming = 2 * (outgoing * half).sum(-1, keepdim=True) * half - outgoing
    return {
        "normal": normal.float(),
        "albedo": torch.rand(COUNT, 3, generator=generator),
        "roughness": torch.full((COUNT,), roughness),
        "outgoing": outgoing.float()[:, None],
        "direction": incoming.float()[:, None],
        "weight": torch.ones(COUNT, 1),
        "visibility": torch.ones(COUNT, 1),
        "indirect": torch.rand(COUNT, 1, 3, generator=generator),
        "environment": stand.sky.radiance,
    }


def lobe(roughness: float, stand: Stand) -> Probe:
    """GGX's D alone, for given half-vectors."""
    given = highlight(roughness, stand)
    half = normalize((given["outgoing"] + given["direction"])[:, 0].double(), dim=-1).float()

    def run(inputs: Values) -> tuple[Tensor, ...]:
        return (ggx_distribution(inputs["half"], inputs["normal"], inputs["roughness"]),)

    inputs = {"half": half, "normal": given["normal"], "roughness": given["roughness"]}
    return Probe(inputs, run, (1.0,), frozenset({"half"}))


def sunlit(intensity: float, stand: Stand) -> Probe:
    """Surfels under the sky with a sun in one texel, sampled by the balance heuristic over hemisphere and light."""
    generator = stand.generator()
    sky = stand.sky.radiance.clone()
    sky[len(sky) // 4, sky.shape[1] // 3] = intensity
    normal = normalize(torch.randn(COUNT, 3, generator=generator), dim=-1)
    spread, _ = hemisphere_directions(normal, SPREAD, generator)
    drawn = LightSampler(EnvironmentMap(sky)).draw(COUNT, DRAWN, generator)
    samples = SPREAD + DRAWN

    def weight(inputs: Values) -> Tensor:
        density = LightSampler(EnvironmentMap(inputs["environment"])).pdf(inputs["direction"])
        return 1 / (SPREAD / (2 * torch.pi) + DRAWN * density)

    return shaded(
        {
            "normal": normal,
            "albedo": torch.rand(COUNT, 3, generator=generator),
            "roughness": 0.1 + 0.9 * torch.rand(COUNT, generator=generator),
            "outgoing": hemisphere_directions(normal, 1, generator)[0],
            "direction": torch.cat([spread, drawn], 1),
            "visibility": torch.rand(COUNT, samples, generator=generator),
            "indirect": torch.rand(COUNT, samples, 3, generator=generator),
            "environment": sky,
        },
        weight,
    )


LIGHT_AXES = (
    Axis(
        "roughness", "roughness", 1.0, (1e-3,),
        {
            # Case 25: of the lobe's peak.
            "shade": Kernel(lambda r, stand: shaded(highlight(r, stand)), lambda r: 1e-5),
            "GGX D": Kernel(lobe, lambda r: 1e-5),
        },
    ),
    # Case 26.
    Axis("sun", "radiance of the sun", 1.0, (1e6,), {"shade": Kernel(sunlit, lambda intensity: 1e-4)}),
)  # fmt: skip
