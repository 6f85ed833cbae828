"""Scenes of a few solids as a probe sees them: surfels with known materials, a sky, views with noise."""

import dataclasses
import math
from collections.abc import Sequence

import torch

from radiogs.effects.plans import Step
from radiogs.effects.probe import Findings, Occasion, probe
from radiogs.effects.probe_scene import ProbeRays, ProbeScene, ProbeView, Viewpoints, trace_scene
from radiogs.rays import RaySettings
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import texel_directions
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh
from radiogs_core.transport.maps import shaded_maps
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box
from scenes import look_at, surfels_over

SAMPLES = 32
PAPER = RaySettings()
CLAY = Material((0.6, 0.5, 0.4), 0.7)
FLOOR = Box((-0.8, -0.8, -0.1), (0.8, 0.8, 0.0), CLAY)


def sky(sun: float = 0.0, sharpness: float = 60.0) -> torch.Tensor:
    """Grey above, darker below; ``sun``: radiance of a lobe 45 degrees high."""
    direction = texel_directions(16, 32).float()
    towards = torch.nn.functional.normalize(torch.tensor([1.0, 0.3, 1.0]), dim=0)
    glow = sun * torch.exp(sharpness * ((direction @ towards) - 1))
    return (0.6 + 0.3 * direction[..., 2:] + glow[..., None]).expand(16, 32, 3).contiguous()


def cameras(height: float = 2.5) -> list[Camera]:
    places = [torch.tensor([2.5 * math.cos(a), 2.5 * math.sin(a), height]) for a in (0.2, 1.8, 3.3, 4.9)]
    return [look_at(place, torch.zeros(3), 32, 40.0) for place in places]


def sheet() -> Surfels:
    """A floor, and over its middle a sheet that has surfels on its upper side alone."""
    roof = surfels_over([Box((-0.5, -0.5, 0.4), (0.5, 0.5, 0.45), CLAY)], 0.12)
    roof = roof.take(torch.nonzero(roof.frame[:, 2, 2] > 0.9)[:, 0]).parameters()
    floor = surfels_over([FLOOR], 0.12).parameters()
    return Surfels.of({name: torch.cat([value, roof[name]]) for name, value in floor.items()})


def seen(
    surfels: Surfels,
    light: torch.Tensor,
    noise: float = 0.02,
    seed: int = 0,
    straight: bool = True,
    variant: RaySettings = PAPER,
) -> ProbeScene:
    """Seen under that light with everything on, as by a method whose images are off by ``noise``.

    ``straight``, ``variant``: how it encodes images and traces rays.
    """
    blind = tuple(ProbeView(camera, None) for camera in cameras())
    rays = ProbeRays(SAMPLES, torch.Generator().manual_seed(seed), variant, offset=0.1)
    viewpoints = Viewpoints(blind, straight)
    made = trace_scene(surfels, light, viewpoints, rays, bounces=True)
    drawn = torch.Generator().manual_seed(99)
    views = tuple(
        ProbeView(view.camera, image + noise * torch.randn(image.shape, generator=drawn))
        for view in blind
        for image in [shown(made, view.camera)]
    )
    return dataclasses.replace(made, views=views)


def shown(made: ProbeScene, camera: Camera) -> torch.Tensor:
    """The image that evaluation renders of the same surfels under the same light, with everything on."""
    surfels, lit = made.surfels, made.incident
    maps = shaded_maps(camera, surfels, surfels.albedo, lit, made.environment, straight=made.straight)
    return maps["image"]


def occlusion(made: ProbeScene) -> torch.Tensor:
    """Share of each surfel's hemisphere, weighted by the cosine, in which distant light is occluded."""
    incident = made.incident
    flow = (incident.direction * made.surfels.frame[:, None, :, 2]).sum(-1).clamp(min=0) * incident.weight
    return 1 - (flow * incident.visibility).sum(1) / flow.sum(1)


def hidden(made: ProbeScene) -> torch.Tensor:
    """The hidden share of the sky of each surfel on the middle of the floor, under the ``sheet``."""
    centre, normal = made.surfels.centre, made.surfels.frame[..., 2]
    return occlusion(made)[(centre.norm(dim=-1) < 0.2) & (normal[:, 2] > 0.9)]


def step(surfels: Surfels) -> Step:
    return Step(len(surfels), 256, SAMPLES, 100)


EFFECTS = ("visibility", "indirect", "specular", "view-dependence")


def found(made: ProbeScene, effects: Sequence[str] = EFFECTS) -> Findings:
    return probe(made, step(made.surfels), Occasion(0), effects)


def grey(surfels: Surfels, radiance: float) -> Surfels:
    own = torch.zeros_like(surfels.sh)
    own[:, 0] = radiance_to_sh(torch.full((len(surfels), 3), radiance))
    return Surfels.of(surfels.parameters() | {"sh": own})
