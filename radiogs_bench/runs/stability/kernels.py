"""The kernels as probes: functions from named inputs of either precision to named outputs."""

from collections.abc import Callable

import torch
from torch import Tensor

from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP, SplatGeometry
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels

from .curve import Probe, Values

GEOMETRY = ("centre", "axis_u", "axis_v", "normal", "opacity")
RAYS = frozenset({"direction", "t_min"})
CHANNELS = 4
DEPTH = 4.0
"""Distance of most cases from the camera, in the scene's unit of length."""


def geometry_of(inputs: Values) -> SplatGeometry:
    """The surfels among a probe's inputs."""
    return SplatGeometry(*(inputs[name] for name in GEOMETRY))


def drawn(camera: Camera, inputs: Values) -> Probe:
    """K1 on ``GEOMETRY`` and features: images, alpha, depth, distortion."""

    def run(given: Values) -> tuple[Tensor, ...]:
        return _images(camera, geometry_of(given), given["features"], 1.0)

    return Probe({name: inputs[name] for name in (*GEOMETRY, "features")}, run, units_of_images(1.0))


def units_of_images(length: float) -> tuple[float, ...]:
    """Units of features, coverage, depth (``length``) and distortion (square of the depth over ``length``)."""
    return (1.0, 1.0, length, DEPTH**2)


def drawn_surfels(camera: Camera, surfels: Surfels, features: Tensor, depth_unit: float = 1.0) -> Probe:
    """K1 on raw surfels, widened by the footprint of a pixel as in training; ``depth_unit`` is the scene's length."""
    raw = ("centre", "rotation", "log_scale", "opacity_logit")
    parameters = surfels.parameters()

    def run(given: Values) -> tuple[Tensor, ...]:
        known = {name: value.to(given["centre"]) for name, value in parameters.items()}
        shown = Surfels.of(known | {name: given[name] for name in raw})
        seen_by = camera.to(given["centre"].device, given["centre"].dtype)
        return _images(seen_by, shown.geometry_for(seen_by), given["features"], depth_unit)

    inputs = {name: parameters[name] for name in raw} | {"features": features}
    return Probe(inputs, run, units_of_images(depth_unit))


def _images(camera: Camera, geometry: SplatGeometry, features: Tensor, depth_unit: float) -> tuple[Tensor, ...]:
    raster = rasterize(camera, geometry, features, depth_unit)
    return raster.features, raster.alpha, raster.depth, raster.distortion


def traced(inputs: Values, length: float = 1.0, stop: float = TRACE_TRANSMITTANCE_STOP) -> Probe:
    """K2 on ``GEOMETRY``, sh, features and rays: radiance, transmittance, features, depth.

    ``length`` is the scene's unit of length.
    """

    def run(given: Values) -> tuple[Tensor, ...]:
        geometry = geometry_of(given)
        hits = trace(
            SurfelBVH.build(geometry.detach()), geometry, given["sh"], given["features"],
            given["origin"], given["direction"], given["t_min"], stop,
        )  # fmt: skip
        return hits.radiance, hits.transmittance, hits.features, hits.depth

    names = (*GEOMETRY, "sh", "features", "origin", "direction", "t_min")
    return Probe({name: inputs[name] for name in names}, run, (1.0, 1.0, 1.0, length), RAYS)


def shaded(inputs: Values, weight: Callable[[Values], Tensor] | None = None) -> Probe:
    """K3: the four parts of the reflected light. ``weight`` makes solid angles that are not inputs."""

    def run(given: Values) -> tuple[Tensor, ...]:
        angles = given["weight"] if weight is None else weight(given)
        parts = shade(
            given["normal"], given["albedo"], given["roughness"], given["outgoing"], given["direction"],
            angles.detach(), given["visibility"], given["indirect"], given["environment"],
        )  # fmt: skip
        return tuple(parts.unbind(2))

    return Probe(inputs, run, (1.0, 1.0, 1.0, 1.0), frozenset({"outgoing", "direction", "weight"}))


def looks(count: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Random features, and harmonics whose radiance stays well above zero, where it is clamped."""
    return {
        "features": torch.rand(count, CHANNELS, generator=generator),
        "sh": 0.1 * torch.rand(count, COEFFICIENTS, 3, generator=generator),
    }


def rays(origin: Tensor, direction: Tensor) -> dict[str, Tensor]:
    """Origins and directions of rays, as the tracer takes them."""
    return {"origin": origin, "direction": direction, "t_min": torch.zeros(len(origin))}
