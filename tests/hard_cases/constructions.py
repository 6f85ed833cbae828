"""Scenes of a few surfels for the hard cases, and how the kernels see them."""

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from radiogs.model import Model
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.harmonics import COEFFICIENTS, surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.splatting import towards

FIELDS = ("centre", "axis_u", "axis_v", "normal", "opacity")
CHANNELS = 4


def looking_along_z(width: int = 9, height: int = 7, focal: float = 9.0, dtype: torch.dtype = torch.float32) -> Camera:
    """A camera at the origin whose axes are the world's: depths are the z of the points, to the last bit."""
    return Camera(torch.eye(4, dtype=dtype), focal, focal, width / 2, height / 2, width, height)


def facing(depth: Tensor, opacity: float | Tensor = 0.5, scale: float = 2.0) -> dict[str, Tensor]:
    """Surfels on the z axis that face the origin, with random features."""
    count = len(depth)
    zero = torch.zeros_like(depth)
    return {
        "centre": torch.stack([zero, zero, depth], -1),
        "axis_u": torch.tensor([1 / scale, 0, 0], dtype=depth.dtype).expand(count, 3),
        "axis_v": torch.tensor([0, -1 / scale, 0], dtype=depth.dtype).expand(count, 3),
        "normal": torch.tensor([0, 0, -1.0], dtype=depth.dtype).expand(count, 3),
        "opacity": torch.as_tensor(opacity, dtype=depth.dtype).expand(count),
        "features": torch.rand(count, CHANNELS, dtype=depth.dtype),
    }


def raw_surfels(count: int, dtype: torch.dtype = torch.float32, spread: float = 1.0) -> Surfels:
    """Surfels about (0, 0, 4) that face the origin up to some 40 degrees, with radiance that depends on direction."""
    like = {"dtype": dtype}
    # A half turn about x takes the normal from +z to -z.
    rotation = torch.tensor([0.0, 1.0, 0.0, 0.0], **like) + 0.2 * torch.randn(count, 4, **like)
    return Surfels(
        centre=torch.tensor([0.0, 0.0, 4.0], **like) + spread * 0.6 * torch.randn(count, 3, **like),
        rotation=normalize(rotation, dim=-1),
        log_scale=torch.log(0.2 + 0.5 * torch.rand(count, 2, **like)),
        opacity_logit=torch.randn(count, **like),
        sh=0.2 * torch.randn(count, COEFFICIENTS, 3, **like),
        albedo_logit=torch.randn(count, 3, **like),
        roughness_logit=torch.randn(count, **like),
    )


def joined(first: Surfels, second: Surfels) -> Surfels:
    """The surfels of both."""
    mine, yours = first.parameters(), second.parameters()
    return Surfels.of({name: torch.cat([mine[name], yours[name]]) for name in mine})


def geometry_of(given: dict[str, Tensor]) -> SplatGeometry:
    return SplatGeometry(*(given[name] for name in FIELDS))


def drawn(camera: Camera, given: dict[str, Tensor], depth_unit: float = 1.0) -> tuple[Tensor, ...]:
    """Features, alpha, depth and distortion by the kernel."""
    raster = rasterize(camera, geometry_of(given), given["features"], depth_unit)
    return raster.features, raster.alpha, raster.depth, raster.distortion


def seen(camera: Camera, surfels: Surfels) -> tuple[Tensor, ...]:
    """Radiance and roughness (4 channels), alpha and depth of raw surfels, as the method draws them."""
    radiance = surfel_radiance(surfels.sh, towards(camera, surfels))
    features = torch.cat([radiance, surfels.roughness[:, None]], -1)
    raster = rasterize(camera, surfels.geometry_for(camera), features, 1.0)
    return raster.features, raster.alpha, raster.depth


def rays_along_z(count: int = 1, spread: float = 0.0, dtype: torch.dtype = torch.float32) -> dict[str, Tensor]:
    """Rays from around the origin along +z."""
    origin = torch.cat([spread * torch.randn(count, 2, dtype=dtype), torch.zeros(count, 1, dtype=dtype)], -1)
    direction = torch.tensor([0.0, 0.0, 1.0], dtype=dtype).expand(count, 3)
    return {"origin": origin, "direction": direction, "t_min": torch.zeros(count, dtype=dtype)}


def cast(given: dict[str, Tensor], rays: dict[str, Tensor], stop: float = 0.03) -> tuple[Tensor, ...]:
    """Radiance, transmittance, features and depth by the kernel; ``given`` also holds ``sh``."""
    geometry = geometry_of(given)
    found = trace(
        SurfelBVH.build(geometry.detach()), geometry, given["sh"], given["features"],
        rays["origin"], rays["direction"], rays["t_min"], stop,
    )  # fmt: skip
    return found.radiance, found.transmittance, found.features, found.depth


def with_radiance(given: dict[str, Tensor], coefficients: int = COEFFICIENTS) -> dict[str, Tensor]:
    """The same surfels with random harmonics."""
    return given | {"sh": 0.3 * torch.randn(len(given["centre"]), coefficients, 3, dtype=given["centre"].dtype)}


def doubled(given: dict[str, Tensor]) -> dict[str, Tensor]:
    """The rounded numbers in float64."""
    return {name: value.double() for name, value in given.items()}


def ball_of_surfels(count: int = 150, dtype: torch.dtype = torch.float32) -> Surfels:
    """A closed ball of radius 1 about the origin, with front sides outwards; half of it is rough."""
    place = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * place / count
    azimuth = place * 2.399963229728653
    ring = (1 - z * z).sqrt()
    outward = torch.stack([ring * azimuth.cos(), ring * azimuth.sin(), z], -1)
    # The shortest rotation from +z to n is the quaternion (1 + n_z, -n_y, n_x, 0).
    rotation = torch.stack([1 + outward[:, 2], -outward[:, 1], outward[:, 0], 0 * z], -1)
    spacing = (4 * torch.pi / count) ** 0.5
    surfels = Surfels(
        centre=outward, rotation=rotation, log_scale=torch.full((count, 2), spacing, dtype=torch.float64).log(),
        opacity_logit=torch.full((count,), 3.0, dtype=torch.float64),
        sh=0.2 * torch.randn(count, COEFFICIENTS, 3, dtype=torch.float64),
        albedo_logit=torch.randn(count, 3, dtype=torch.float64),
        roughness_logit=torch.randn(count, dtype=torch.float64),
    )  # fmt: skip
    return Surfels.of({name: value.to(dtype) for name, value in surfels.parameters().items()})


def two_balls(dtype: torch.dtype = torch.float32) -> Surfels:
    """Two balls that see each other: visibility and indirect light matter."""
    left, right = ball_of_surfels(dtype=dtype), ball_of_surfels(dtype=dtype)
    left.centre = left.centre - torch.tensor([1.2, 0, 0], dtype=dtype)
    right.centre = right.centre + torch.tensor([1.2, 0, 0], dtype=dtype)
    return joined(left, right)


def moved(surfels: Surfels, camera: Camera, factor: float = 1.0, shift: float = 0.0) -> tuple[Surfels, Camera]:
    """World and camera times ``factor``, then moved by ``shift`` along each axis; all rounded to their type."""
    parameters = surfels.parameters()
    parameters["centre"] = (surfels.centre.double() * factor + shift).to(surfels.centre.dtype)
    parameters["log_scale"] = surfels.log_scale + torch.tensor(factor, dtype=torch.float64).log().item()
    matrix = camera.camera_to_world.clone()
    matrix[:3, 3] = (matrix[:3, 3].double() * factor + shift).to(matrix.dtype)
    return Surfels.of(parameters), replace(camera, camera_to_world=matrix)


def rendered(surfels: Surfels, camera: Camera, samples: int = 16) -> dict[str, Tensor]:
    """The finished maps: traced light, shaded surfels, splatted images."""
    torch.manual_seed(4)
    light = torch.randn(8, 16, 3, dtype=torch.float64).to(surfels.centre.dtype)
    return Renderer(Model(surfels, light), samples, Variant()).render(camera)


def unit(count: int) -> Tensor:
    """Random unit directions, float64."""
    return normalize(torch.randn(count, 3, dtype=torch.float64), dim=-1)


def seeded(seed: int = 0) -> torch.Generator:
    """A generator of its own."""
    return torch.Generator().manual_seed(seed)


def assert_same_bits(found: tuple[Tensor, ...], expected: tuple[Tensor, ...]) -> None:
    """Each of the tensors equals the expected one exactly."""
    assert all(torch.equal(ours, theirs) for ours, theirs in zip(found, expected, strict=True))


def assert_near(
    found: tuple[Tensor, ...], expected: tuple[Tensor, ...], tolerance: float, relative: bool = False
) -> None:
    """No entry is off by more than ``tolerance``, in float64; relative to the largest entry where it is above one."""
    for ours, theirs in zip(found, expected, strict=True):
        unit = max(1.0, float(theirs.abs().max())) if relative else 1.0
        torch.testing.assert_close(ours.double(), theirs.double(), rtol=0, atol=tolerance * unit)


def shell(count: int, scale: float = 1.0, offset: float = 0.0) -> SplatGeometry:
    """Surfels over a sphere of radius ``scale`` about (offset, offset, offset), seen from inside; float32."""
    place = torch.arange(count, dtype=torch.float64) + 0.5
    z = 1 - 2 * place / count
    azimuth = place * 2.399963229728653
    outward = torch.stack([(1 - z * z).sqrt() * azimuth.cos(), (1 - z * z).sqrt() * azimuth.sin(), z], -1)
    tangent = normalize(torch.linalg.cross(outward, torch.tensor([0.3, 0.5, 0.8]).double().expand_as(outward)), dim=-1)
    sigma = scale * (4 * torch.pi / count) ** 0.5
    fields = (scale * outward + offset, tangent / sigma, torch.linalg.cross(outward, tangent) / sigma, -outward)
    return SplatGeometry(*(value.float() for value in fields), torch.full((count,), 0.95))
