"""Cases 15 to 17 and 22: surfels at the camera and in its plane, and images of any shape."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from hard_cases import ref64
from hard_cases.constructions import (
    FIELDS,
    assert_near,
    assert_same_bits,
    drawn,
    facing,
    joined,
    looking_along_z,
    raw_surfels,
    seen,
)
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.transport.splatting import towards


def share_beyond(found: Tensor, expected: Tensor, tolerance: float) -> float:
    """Share of pixels that differ by more than ``tolerance``."""
    difference = (found.double() - expected.double()).abs()
    return float((difference.flatten(2).amax(-1) if difference.dim() > 2 else difference).gt(tolerance).double().mean())


def tilted(depth: float, count: int = 1) -> dict[str, Tensor]:
    """Large surfels about (0, 0, depth) that lean by 60 degrees: they cross the camera's plane."""
    given = facing(torch.full((count,), depth), 0.8)
    lean = torch.tensor([math.cos(1.0), 0.0, math.sin(1.0)])
    normal = torch.tensor([math.sin(1.0), 0.0, -math.cos(1.0)])
    given["centre"] = given["centre"] + torch.tensor([-0.3, 0.0, 0.0])
    return given | {"axis_u": (lean / 1.5).expand(count, 3), "normal": normal.expand(count, 3)}


@pytest.mark.case(15)
@pytest.mark.parametrize("depth", [-0.5, -0.1, 0.0, 0.1, 0.5])
def test_a_surfel_through_the_cameras_plane_has_no_ghost_behind_it(depth: float) -> None:
    camera, given = looking_along_z(20, 15), tilted(depth)
    expected = ref64.image(camera, given, given["features"])
    found = drawn(camera, given)
    assert_near(found[:2], expected[:2], 1e-6)
    assert_near(found[2:3], expected[2:3], 1e-6, relative=True)
    behind = facing(torch.tensor([-2.0]), 0.9, scale=10.0) | {"normal": torch.tensor([[0.0, 0.0, 1.0]])}
    both = {name: torch.cat([given[name], behind[name]]) for name in given}
    assert_same_bits(drawn(camera, both), found)


@pytest.mark.case(16)
@pytest.mark.parametrize("depth", [1e-6, -1e-6, 1e-3, -1e-3])
def test_a_centre_on_the_cameras_plane_does_not_pop(depth: float) -> None:
    """There is no near plane; the camera's own plane is the nearest thing to one. Either side of it looks the same."""
    camera = looking_along_z(32, 32)
    given = tilted(depth)
    exact = ref64.image(camera, given, given["features"])
    found = drawn(camera, given)
    assert float(exact[1].max()) > 0.1
    assert share_beyond(found[0], exact[0], 1e-4) <= 1e-3
    here, there = (drawn(camera, tilted(sign * depth) | {"features": given["features"]})[0] for sign in (1, -1))
    assert share_beyond(here, there, 10 * abs(depth)) <= 1e-3


@pytest.mark.case(17)
def test_a_surfel_at_the_cameras_centre_is_not_drawn_and_harms_none() -> None:
    camera, sound, inside = looking_along_z(), raw_surfels(8), raw_surfels(1)
    inside.centre = torch.zeros(1, 3, requires_grad=True)
    found = seen(camera, joined(sound, inside))
    assert_same_bits(found, seen(camera, sound))
    torch.stack([value.sum() for value in found]).sum().backward()
    assert inside.centre.grad is not None
    assert bool((inside.centre.grad == 0).all())


@pytest.mark.case(17)
@pytest.mark.parametrize("depth", [1e-7, -1e-7])
def test_a_surfel_next_to_the_cameras_centre_is_what_float64_says(depth: float) -> None:
    """Behind it nothing, before it a curtain: without a near plane that is the image."""
    camera = looking_along_z()
    given = facing(torch.tensor([depth, 2.0]), 0.5)
    found, exact = drawn(camera, given), ref64.image(camera, given, given["features"])
    assert float(exact[1].max()) > 0.4
    assert_near(found, exact, 1e-6)


@pytest.mark.case(22)
@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 17), (17, 1), (15, 33), (4096, 1)])
def test_images_of_any_shape_have_no_missing_and_no_foreign_pixel(width: int, height: int) -> None:
    camera = looking_along_z(width, height, focal=max(width, height) * 1.0)
    surfels = raw_surfels(8) if width * height < 1000 else raw_surfels(2)
    given = {name: getattr(surfels.geometry_for(camera), name) for name in FIELDS}
    features = torch.cat([surfel_radiance(surfels.sh, towards(camera, surfels)), surfels.roughness[:, None]], -1)
    found = drawn(camera, given | {"features": features})
    if width < 4096:
        expected = ref64.image(camera, given, features)
    else:
        # Pixels of a row do not know of each other: a sample of them, each as a camera of its own.
        columns = torch.arange(3, width, 61)
        found = tuple(value[:, columns] for value in found)
        pixel = [
            ref64.image(replace(camera, cx=camera.cx - int(column), width=1), given, features) for column in columns
        ]
        expected = tuple(torch.cat(values, 1) for values in zip(*pixel, strict=True))
    assert_near(found[:3], expected[:3], 2e-6, relative=True)
