"""Cost of a relit frame: shaded from incident rays, or splatted from the surfels' own radiance (``bench frames``)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle, islice
from statistics import median

import torch

from radiogs_core.errors import DataError
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.light_sampler import LightSampler
from radiogs_core.scene.scene import Scene
from radiogs_core.surfels.known_surfaces import surfels_on
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.maps import radiance_maps, shaded_maps
from radiogs_core.transport.sampling import relighting_directions
from radiogs_core.transport.tracer import SurfelTracer, incident_along

from .clock import seconds

HEMISPHERE_SAMPLES, LIGHT_SAMPLES = 256, 128
"""Directions per surfel in preset ``paper`` when a model is relit."""

FRAMES = 8
"""Timed frames, over the scene's test views in turn."""

WARM_UP = 2
"""Frames before these that are not timed."""


@dataclass(frozen=True)
class FrameRow:
    """Medians over the frames, on one core (CUDA: the whole device)."""

    spacing: float
    surfels: int
    rays_milliseconds: float
    surfels_milliseconds: float

    @property
    def ratio(self) -> float:
        """Speed-up of the surfels alone."""
        return self.rays_milliseconds / self.surfels_milliseconds


def bench_frames(
    scene: Scene, spacings: Sequence[float], device: torch.device, announce: Callable[[str], None]
) -> Iterator[FrameRow]:
    """Frames of a generated scene whose solids are covered by surfels ``spacing`` world units apart.

    The cost of a frame depends on the number of visible surfels, not on their values: their radiance is grey here.
    Incident rays are traced once, before anything is timed, as for any relit model. The two ways are measured in turn,
    so that both see the same load. Raises DataError for a scene whose surfaces or light are not known.
    """
    if scene.training_light is None:
        raise DataError(f"the light of scene '{scene.name}' is not known", "Frames are shaded under it.")
    use_threads(1)
    light = EnvironmentMap(scene.training_light.radiance.to(device))
    cameras = [view.camera.to(device, torch.float32) for view in islice(cycle(scene.test), WARM_UP + FRAMES)]
    for spacing in spacings:
        surfels = surfels_on(scene.true_surfaces(spacing))
        surfels = Surfels.of({name: value.to(device) for name, value in surfels.parameters().items()})
        announce(f"{len(surfels)} surfels, {spacing:g} apart")
        ways = (by_rays(surfels, light), partial(radiance_maps, surfels=surfels))
        taken = [
            [1e3 * seconds(partial(way, camera), device) for way in ways] for camera in cameras
        ][WARM_UP:]  # fmt: skip
        yield FrameRow(spacing, len(surfels), *map(median, zip(*taken, strict=True)))


@torch.no_grad()
def by_rays(surfels: Surfels, light: EnvironmentMap) -> Callable[[Camera], object]:
    """A renderer of the surfels for any camera, shaded from incident light that is traced now."""
    generator = torch.Generator(surfels.centre.device).manual_seed(0)
    direction, weight = relighting_directions(
        surfels.frame[..., 2], LightSampler(light), HEMISPHERE_SAMPLES, LIGHT_SAMPLES, generator
    )
    incident = incident_along(SurfelTracer(surfels), direction, weight)
    return lambda camera: shaded_maps(camera, surfels, surfels.albedo, incident, light.radiance)
