"""Normals of depth maps: planes, creases and silhouettes by both kinds of differences."""

import math

import pytest
import torch

from radiogs_core.kernels.image.depth_map import one_sided_normals
from radiogs_core.kernels.image.display import displayed
from radiogs_core.scene.camera import Camera
from radiogs_core.transport.splatting import depth_normals

CENTRE = torch.zeros(3, dtype=torch.float64)
SIZE = 33


def rays() -> torch.Tensor:
    camera = Camera(torch.eye(4, dtype=torch.float64), 40.0, 40.0, SIZE / 2, SIZE / 2, SIZE, SIZE)
    return camera.ray_directions()


def seen(planes: list[tuple[torch.Tensor, float]]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Points and z-depth of the nearest of planes n . x = d, and the true normal of each pixel, towards the camera."""
    directions = rays()
    depths = torch.stack([distance / (directions @ normal) for normal, distance in planes])
    depths = torch.where(depths > 0, depths, torch.inf)
    depth, which = depths.min(0)
    normals = torch.stack([normal for normal, _ in planes])[which]
    facing = (normals * directions).sum(-1, keepdim=True) < 0
    return directions * depth[..., None], depth, torch.where(facing, normals, -normals)


def plane(x: float, y: float, z: float) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.tensor([x, y, z], dtype=torch.float64), dim=-1)


def degrees(ours: torch.Tensor, theirs: torch.Tensor) -> torch.Tensor:
    return torch.rad2deg(torch.acos((ours * theirs).sum(-1).clamp(-1, 1)))


ROOF = [(plane(1.0, 0.2, 1.0), 3.0), (plane(-1.0, 0.1, 1.0), 3.0)]
"""Two planes that meet in a crease across the image and come nearer to the camera on both sides of it."""


def test_both_find_the_normal_of_a_plane_seen_at_an_angle() -> None:
    points, depth, truth = seen([(plane(0.6, -0.5, 1.0), 3.0)])
    inner = (slice(1, -1), slice(1, -1))
    everywhere = torch.ones(SIZE, SIZE, dtype=torch.bool)
    central = depth_normals(points, CENTRE)
    assert float(degrees(central, truth)[inner].max()) < 1e-4
    assert not any(bool(edge.any()) for edge in (central[0], central[-1], central[:, 0], central[:, -1]))
    assert float(degrees(one_sided_normals(points, depth, everywhere, CENTRE), truth).max()) < 1e-4


def test_at_a_crease_one_sided_differences_stay_on_one_of_its_faces() -> None:
    points, depth, truth = seen(ROOF)
    everywhere = torch.ones(SIZE, SIZE, dtype=torch.bool)
    one_sided = degrees(one_sided_normals(points, depth, everywhere, CENTRE), truth)
    central = degrees(depth_normals(points, CENTRE), truth)[1:-1, 1:-1]
    assert float(one_sided.max()) < 1e-4
    assert float(central.max()) > 20


def test_beside_a_silhouette_only_the_object_counts() -> None:
    points, depth, truth = seen([(plane(0.3, 0.2, 1.0), 3.0)])
    solid = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    solid[8:20, 5:17] = True
    away = torch.where(solid, depth, 0.0)
    found = one_sided_normals(torch.where(solid[..., None], points, 0.0), away, solid, CENTRE)
    assert float(degrees(found, truth)[solid].max()) < 1e-4
    assert not bool(found[~solid].any())


def test_a_pixel_without_a_neighbour_has_no_normal() -> None:
    points, depth, _ = seen([(plane(0.0, 0.0, 1.0), 2.0)])
    solid = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    solid[10, 10] = solid[20, 4] = solid[20, 5] = True
    assert not bool(one_sided_normals(points, torch.where(solid, depth, 0.0), solid, CENTRE).any())


def test_the_gradient_agrees_with_finite_differences() -> None:
    points, depth, _ = seen(ROOF)
    everywhere = torch.ones(SIZE, SIZE, dtype=torch.bool)
    weight = torch.randn(SIZE, SIZE, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def value(moved: torch.Tensor) -> torch.Tensor:
        return (weight * one_sided_normals(moved, depth, everywhere, CENTRE)).sum()

    points = points.clone().requires_grad_()
    value(points).backward()
    shift = torch.randn(points.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    step = 1e-6
    difference = (value(points.detach() + step * shift) - value(points.detach() - step * shift)) / (2 * step)
    assert points.grad is not None
    assert float((points.grad * shift).sum()) == pytest.approx(float(difference), rel=1e-5)


def test_a_half_covered_pixel_shows_half_the_values() -> None:
    radiance = torch.tensor([0.5, 0.2, 0.05]).expand(1, 2, 3)
    alpha = torch.tensor([[1.0, 0.5]])
    whole, half = displayed(radiance * alpha[..., None], alpha)[0]
    torch.testing.assert_close(half, 0.5 * whole)
    encoded = 1.055 * 0.5 ** (1 / 2.4) - 0.055
    assert float(whole[0]) == pytest.approx(encoded, rel=1e-6)
    _, premultiplied = displayed(radiance * alpha[..., None], alpha, straight=False)[0]
    assert float(premultiplied[0]) == pytest.approx(1.055 * 0.25 ** (1 / 2.4) - 0.055, rel=1e-6)
    assert not bool(displayed(torch.zeros(1, 1, 3), torch.zeros(1, 1)).any())
    assert math.isfinite(float(displayed(torch.full((1, 1, 3), 1e-30), torch.full((1, 1), 1e-30)).sum()))
