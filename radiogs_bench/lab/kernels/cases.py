"""The measured cases: forward pass, backward pass and yardstick, each ready to run."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import partial

import torch
from torch import Tensor

from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.surfel.geometry import SplatGeometry
from radiogs_core.kernels.surfel.harmonics import harmonic_sum
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.scene.camera import Camera
from radiogs_core.transport.prefiltered_light import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.sampling import hemisphere_directions

from .embree import closest_hits, missing_embree
from .plain import harmonics_plainly, rasterize_densely, shade_plainly, split_sum_plainly
from .scenes import KernelScene

SHADED_SURFELS, SHADED_SAMPLES = 4000, 64
SEEN_SURFELS = 30_000
LIGHT_HEIGHT = 16
CHANNELS = 13


@dataclass(frozen=True)
class Yardstick:
    """Other code for the same purpose; ``backward`` if it has one."""

    name: str
    forward: Callable[[], object]
    backward: Callable[[], Callable[[], object]] | None


@dataclass(frozen=True)
class Case:
    """One kernel on one input."""

    kernel: str
    scene: str
    """Name of the input."""
    dtype: torch.dtype
    items: int
    """Number of items, in which rates are counted."""
    item: str
    """Name of an item."""
    forward: Callable[[], object]
    """Runs the forward pass, without gradient."""
    backward: Callable[[], Callable[[], object]]
    """Runs the forward pass, and returns a function that runs the backward pass."""
    yardstick: Yardstick | None
    """The same work by another library; None without a yardstick."""


def trace_case(scene: KernelScene, dtype: torch.dtype, device: torch.device) -> Case:
    """Blending along all rays of a scene, beside Embree's closest hit (float32, one CPU core)."""
    geometry = _geometry(scene, dtype, device)
    bvh = SurfelBVH.build(geometry)
    origin, direction, t_min = (value.to(device, dtype) for value in (scene.origin, scene.direction, scene.t_min))
    leaves = [getattr(geometry, field.name) for field in fields(geometry)]
    leaves += [value.to(device, dtype) for value in (scene.sh, scene.features)] + [origin]

    def run(values: list[Tensor]) -> Tensor:
        hits = trace(bvh, SplatGeometry(*values[:5]), values[5], values[6], values[7], direction, t_min)
        return hits.radiance.sum() + hits.transmittance.sum() + hits.features.sum() + hits.depth.sum()

    yardstick = None if missing_embree() else Yardstick("Embree closest hit", closest_hits(scene), None)
    return Case("trace", scene.name, dtype, len(origin), "ray", *_passes(run, leaves), yardstick)


def rasterize_case(scene: KernelScene, size: int, dtype: torch.dtype, device: torch.device, dense: bool) -> Case:
    """An image of CHANNELS features from outside the scene, beside every pixel against every surfel."""
    geometry = _geometry(scene, dtype, device)
    camera = square_camera(size).to(device, dtype)
    generator = torch.Generator().manual_seed(1)
    features = torch.rand(len(geometry), CHANNELS, generator=generator).to(device, dtype)
    leaves = [*(getattr(geometry, field.name) for field in fields(geometry)), features]

    def run(values: list[Tensor]) -> Tensor:
        raster = rasterize(camera, SplatGeometry(*values[:5]), values[5], 1.0)
        return raster.features.sum() + raster.depth.sum() + raster.distortion.sum()

    plain = _passes(lambda values: rasterize_densely(camera, SplatGeometry(*values[:5]), values[5]).sum(), leaves)
    yardstick = Yardstick("dense PyTorch", *plain) if dense else None
    name = f"{scene.name}, {size} x {size}"
    return Case("rasterize", name, dtype, size * size, "pixel", *_passes(run, leaves), yardstick)


def shade_case(dtype: torch.dtype, device: torch.device) -> Case:
    """Eq. 8 for SHADED_SURFELS times SHADED_SAMPLES, one view each, beside the same sum as PyTorch expressions."""
    generator = torch.Generator().manual_seed(0)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    def unit(*shape: int) -> Tensor:
        return torch.nn.functional.normalize(torch.randn(*shape, generator=generator, dtype=torch.float64), dim=-1)

    count, samples = SHADED_SURFELS, SHADED_SAMPLES
    normal, outgoing = unit(count, 3), unit(count, 1, 3)
    outgoing = torch.where((outgoing * normal[:, None]).sum(-1, keepdim=True) < 0, -outgoing, outgoing)
    direction, weight = hemisphere_directions(normal, samples, generator)
    given = [normal, uniform(count, 3), 0.1 + 0.9 * uniform(count), outgoing, direction, weight]
    given += [uniform(count, samples), uniform(count, samples, 3), uniform(LIGHT_HEIGHT, 2 * LIGHT_HEIGHT, 3)]
    leaves = [value.to(device, dtype) for value in given]
    made_without_gradient = (3, 4, 5)
    passes = _passes(lambda values: shade(*values).sum(), leaves, made_without_gradient)
    plain = _passes(lambda values: shade_plainly(*values).sum(), leaves, made_without_gradient)
    name = f"{count} x {samples}"
    return Case("shade", name, dtype, count * samples, "sample", *passes, Yardstick("plain PyTorch", *plain))


def harmonics_case(dtype: torch.dtype, device: torch.device) -> Case:
    """The radiance of SEEN_SURFELS towards one camera, all 16 harmonics, beside the same sum as PyTorch expressions."""
    generator = torch.Generator().manual_seed(0)
    sh = torch.randn(SEEN_SURFELS, 16, 3, generator=generator, dtype=torch.float64)
    towards = torch.randn(SEEN_SURFELS, 1, 3, generator=generator, dtype=torch.float64)
    leaves = [value.to(device, dtype) for value in (sh, torch.nn.functional.normalize(towards, dim=-1))]
    passes = _passes(lambda values: harmonic_sum(*values).sum(), leaves)
    plain = _passes(lambda values: harmonics_plainly(*values).sum(), leaves)
    name = f"{SEEN_SURFELS} x 1"
    return Case("harmonics", name, dtype, SEEN_SURFELS, "surfel", *passes, Yardstick("plain PyTorch", *plain))


def split_sum_case(dtype: torch.dtype, device: torch.device) -> Case:
    """SEEN_SURFELS shaded towards one camera under a learnt light, as in stage 1, beside PyTorch expressions."""
    generator = torch.Generator().manual_seed(0)

    def unit() -> Tensor:
        return torch.nn.functional.normalize(
            torch.randn(SEEN_SURFELS, 3, generator=generator, dtype=torch.float64), dim=-1
        )

    uniform = torch.rand(SEEN_SURFELS, 4, generator=generator, dtype=torch.float64)
    light = torch.rand(LIGHT_HEIGHT, 2 * LIGHT_HEIGHT, 3, generator=generator, dtype=torch.float64)
    given = [unit(), uniform[:, :3].contiguous(), uniform[:, 3].contiguous(), unit(), light]
    leaves = [value.to(device, dtype) for value in given]

    ours, plain = (_passes(partial(_summed, shaded), leaves) for shaded in (split_sum_radiance, split_sum_plainly))
    name = f"{SEEN_SURFELS} x 1"
    return Case("split-sum", name, dtype, SEEN_SURFELS, "surfel", *ours, Yardstick("plain PyTorch", *plain))


def _summed(shaded: Callable[..., Iterable[Tensor]], values: list[Tensor]) -> Tensor:
    """The sum of all parts of the radiance of surfels under a light, which is the last of the values."""
    *surfels, radiance = values
    return torch.cat([*shaded(*surfels, PrefilteredLight(radiance))]).sum()


def _passes(
    run: Callable[[list[Tensor]], Tensor], leaves: list[Tensor], constant: tuple[int, ...] = ()
) -> tuple[Callable[[], object], Callable[[], Callable[[], object]]]:
    @torch.no_grad()
    def forward() -> object:
        return run(leaves)

    def backward() -> Callable[[], object]:
        values = [value.detach().requires_grad_(index not in constant) for index, value in enumerate(leaves)]
        total = run(values)
        return total.backward

    return forward, backward


def _geometry(scene: KernelScene, dtype: torch.dtype, device: torch.device) -> SplatGeometry:
    return SplatGeometry(*(getattr(scene.geometry, field.name).to(device, dtype) for field in fields(SplatGeometry)))


def square_camera(size: int) -> Camera:
    """At (4, 0, 0), looking at the origin, Z up, 40 degrees across."""
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = torch.tensor([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], dtype=torch.float64)
    pose[0, 3] = 4.0
    focal = size / 2 / math.tan(math.radians(20))
    return Camera(pose, focal, focal, size / 2, size / 2, size, size)
