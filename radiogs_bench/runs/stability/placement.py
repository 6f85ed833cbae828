"""Axes of placement: scale of the scene, and distance from the origin."""

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import COEFFICIENTS
from radiogs_core.surfels.surfels import Surfels

from .curve import Axis, Kernel, Probe, Stand
from .kernels import DEPTH, GEOMETRY, drawn_surfels, looks, rays, traced

COUNT = 24
RAYS = 128


def scattered(count: int, generator: torch.Generator, spread: float = 1.0) -> Surfels:
    """Surfels about (0, 0, DEPTH) that face the origin up to some 40 degrees."""

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    # Half a turn about x takes the normal from +z to -z.
    rotation = torch.tensor([0.0, 1.0, 0.0, 0.0]) + 0.2 * normal(count, 4)
    return Surfels(
        centre=torch.tensor([0.0, 0.0, DEPTH]) + spread * 0.6 * normal(count, 3),
        rotation=normalize(rotation, dim=-1),
        log_scale=torch.log(0.2 + 0.5 * torch.rand(count, 2, generator=generator)),
        opacity_logit=normal(count),
        sh=torch.zeros(count, COEFFICIENTS, 3),
        albedo_logit=torch.zeros(count, 3),
        roughness_logit=torch.zeros(count),
    )


def moved(surfels: Surfels, camera: Camera, factor: float, shift: float) -> tuple[Surfels, Camera]:
    """World and camera scaled by ``factor`` and then moved by ``shift`` along each axis, rounded to float32."""
    parameters = surfels.parameters()
    parameters["centre"] = (surfels.centre.double() * factor + shift).float()
    parameters["log_scale"] = (surfels.log_scale.double() + torch.tensor(factor, dtype=torch.float64).log()).float()
    pose = camera.camera_to_world.double()
    pose[:3, 3] = pose[:3, 3] * factor + shift
    return Surfels.of(parameters), replace(camera, camera_to_world=pose.float())


def drawn_at(factor: float, shift: float, stand: Stand) -> Probe:
    """Rasterize the scattered surfels."""
    generator = stand.generator()
    surfels, camera = moved(scattered(COUNT, generator), stand.camera, factor, shift)
    return drawn_surfels(camera, surfels, looks(COUNT, generator)["features"], depth_unit=factor)


def traced_at(factor: float, shift: float, stand: Stand) -> Probe:
    """Trace rays from the camera's centre to the scattered surfels."""
    generator = stand.generator()
    surfels, camera = moved(scattered(COUNT, generator), stand.camera, factor, shift)
    geometry = surfels.geometry()
    slope = 0.6 * torch.rand(RAYS, 2, generator=generator) - 0.3
    direction = normalize(torch.cat([slope, torch.ones(RAYS, 1)], -1).double(), dim=-1).float()
    start = camera.centre.repeat(RAYS, 1)
    fields = {name: getattr(geometry, name) for name in GEOMETRY}
    return traced(fields | looks(COUNT, generator) | rays(start, direction), length=factor)


def steady(condition: float) -> float:
    """Tolerance of cases 18 and 19: neither scale nor position matters, apart from quantisation."""
    return 1e-4


PLACEMENT_AXES = (
    Axis(
        "scale", "scale of the scene", 1.0, (1e-6, 1e6),
        {
            "draw": Kernel(lambda factor, stand: drawn_at(factor, 0.0, stand), steady),
            "trace": Kernel(lambda factor, stand: traced_at(factor, 0.0, stand), steady),
        },
    ),
    Axis(
        "translation", "distance from the origin", 1.0, (1e6,),
        {
            "draw": Kernel(lambda shift, stand: drawn_at(1.0, shift, stand), steady),
            "trace": Kernel(lambda shift, stand: traced_at(1.0, shift, stand), steady),
        },
    ),
)  # fmt: skip
