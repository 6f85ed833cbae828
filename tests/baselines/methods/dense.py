"""Shared parts of the float64 references of several methods: what pixels see by loops, the display curve, gradients."""

from collections.abc import Callable

import torch
from torch import Tensor

from baselines.methods.irgs.world import sheet
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from reference.differences import Values
from reference.rasterize import rasterize

F64 = torch.float64


def floor(opacity: float = 0.7) -> tuple[Surfels, Surfels]:
    """Two overlapping surfels of different materials that lean to different sides."""
    return (
        sheet(0.0, (0.1, 0.0, 0.995), 1.2, opacity, 0.6, 0.5, dtype=F64),
        sheet(-0.1, (0, -0.1, 0.995), 1.5, 0.9, dtype=F64),
    )


def surfels_of(values: Values) -> Surfels:
    """The surfels among the values."""
    return Surfels.of({name: values[name] for name in Surfels.names()})


def seen(camera: Camera, surfels: Surfels, *columns: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Normals and further columns of the surfels, alpha and depth, blended in each pixel by the reference."""
    drawn = surfels.geometry_for(camera)
    features, alpha, depth, _ = rasterize(
        camera.axes, camera.centre, camera.ray_directions().flatten(0, 1), drawn.centre, drawn.axis_u, drawn.axis_v,
        drawn.normal, drawn.opacity, torch.cat([drawn.normal, *columns], -1), 1.0,
    )  # fmt: skip
    return features, alpha, depth


def encode(linear: Tensor) -> Tensor:
    """The sRGB curve, not clipped."""
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp(min=1e-9) ** (1 / 2.4) - 0.055)


def gradients(of: Callable[[Values], Tensor], values: Values, names: tuple[str, ...]) -> Values:
    """Gradients of a number to the named values that it depends on."""
    leaves = {name: value.clone().requires_grad_(name in names) for name, value in values.items()}
    of(leaves).backward()
    return {name: grad for name in names if (grad := leaves[name].grad) is not None}


def assert_same_gradients(ours: Values, theirs: Values, names: tuple[str, ...], tolerance: float = 1e-8) -> None:
    """Both are gradients to all these names, and equal up to a share of the largest of their kind."""
    assert set(ours) == set(theirs) == set(names)
    for name, gradient in theirs.items():
        assert gradient.abs().max() > 0, name
        assert (ours[name] - gradient).abs().max() < tolerance * gradient.abs().max(), name
