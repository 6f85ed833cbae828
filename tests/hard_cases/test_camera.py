"""Cases 16, 17, 21, 23 and 24: surfels at the camera, scenes of nothing and of too much, closed and flat surfaces."""

import math

import pytest
import torch
from torch import Tensor

from hard_cases import ref64
from hard_cases.constructions import (
    assert_near,
    assert_same_bits,
    drawn,
    facing,
    geometry_of,
    joined,
    looking_along_z,
    raw_surfels,
    seen,
    shell,
)
from radiogs.model import Model
from radiogs.settings import Variant
from radiogs.showing import Renderer
from radiogs_core.errors import UsageError
from radiogs_core.kernels.rasterize.binning import tile_lists
from radiogs_core.kernels.rasterize.projection import project
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.hits import begins_of, number_of_entries
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.tracer import SurfelTracer, gather_incident


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


@pytest.mark.case(16)
@pytest.mark.parametrize("depth", [1e-6, -1e-6, 1e-3, -1e-3])
def test_a_centre_on_the_cameras_plane_does_not_pop(depth: float) -> None:
    """There is no near plane; the closest thing to one is the camera's own plane, whose two sides look the same."""
    camera = looking_along_z(32, 32)
    given = tilted(depth)
    exact = ref64.image(camera, given, given["features"])
    found = drawn(camera, given)
    assert float(exact[1].max()) > 0.1
    assert share_beyond(found[0], exact[0], 1e-4) <= 1e-3
    here, there = (drawn(camera, tilted(sign * depth) | {"features": given["features"]})[0] for sign in (1, -1))
    assert share_beyond(here, there, 10 * abs(depth)) <= 1e-3


@pytest.mark.case(17)
def test_a_surfel_at_the_cameras_centre_is_not_drawn_and_harms_no_other() -> None:
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


@pytest.mark.case(21)
@pytest.mark.parametrize("kind", ["none", "all behind", "one"])
def test_empty_and_nearly_empty_scenes_render_and_take_gradients(kind: str) -> None:
    surfels, camera = raw_surfels(0 if kind == "none" else 5), looking_along_z()
    if kind == "all behind":
        surfels.centre = surfels.centre - torch.tensor([0.0, 0.0, 20.0])
    if kind == "one":
        surfels = surfels.take(torch.tensor([0]))
    leaves = {name: value.clone().requires_grad_() for name, value in surfels.parameters().items()}
    of = Surfels.of(leaves)
    found = seen(camera, of)
    torch.stack([value.sum() for value in found]).sum().backward()
    assert all(leaf.grad is None or bool(torch.isfinite(leaf.grad).all()) for leaf in leaves.values())
    maps = Renderer(Model(surfels, torch.zeros(4, 8, 3)), 4, Variant()).render(camera)
    if kind != "one":
        assert all(bool((value == 0).all()) for value in (*found, *maps.values()))
        assert all(leaf.grad is None or bool((leaf.grad == 0).all()) for leaf in leaves.values())
    else:
        assert float(maps["alpha"].max()) > 0
        assert bool((maps["indirect"] == 0).all())


@pytest.mark.case(23)
def test_more_pairs_than_an_index_holds_are_counted_in_64_bits_and_refused() -> None:
    """Ten surfels over an image of 10^12 pixels: 6.25e11 pairs, of which nothing is allocated."""
    camera = looking_along_z(1_000_000, 1_000_000, focal=1e6)
    given = facing(torch.full((10,), 2.0), 0.9, scale=100.0)
    with pytest.raises(UsageError, match="625000000000 pairs"):
        tile_lists(camera, project(camera, geometry_of(given)).bounds)


@pytest.mark.case(23)
def test_more_hits_than_an_index_holds_are_counted_in_64_bits_and_refused() -> None:
    most = torch.iinfo(torch.int32).max
    counts = torch.tensor([most - 5, 5], dtype=torch.int32)
    assert (begins_of(counts).tolist(), number_of_entries(counts)) == ([0, most - 5, most], most)
    with pytest.raises(UsageError, match=f"{most + 1} hits"):
        number_of_entries(torch.tensor([most - 5, 6], dtype=torch.int32))


@pytest.mark.case(24)
@pytest.mark.parametrize(
    ("scale", "offset"), [(1e-3, 0.0), (1.0, 0.0), (1e3, 0.0), (1.0, 1e4), (1e3, 1e6), (10.0, 1e6)]
)
def test_a_closed_shell_does_not_leak(scale: float, offset: float) -> None:
    """4800 rays from the surfels' own centres, starting one standard deviation away as the method's do."""
    count = 800
    geometry = shell(count, scale, offset)
    direction = torch.nn.functional.normalize(torch.randn(6 * count, 3), dim=-1)
    normal = geometry.normal.repeat(6, 1)
    direction = torch.where((direction * normal).sum(-1, keepdim=True) < 0, -direction, direction)
    found = trace(
        SurfelBVH.build(geometry), geometry, torch.zeros(count, 1, 3), torch.zeros(count, 0),
        geometry.centre.repeat(6, 1), direction, torch.full((6 * count,), scale * (4 * torch.pi / count) ** 0.5),
    )  # fmt: skip
    assert float((found.transmittance >= 0.03).double().mean()) < 1e-3


@pytest.mark.case(24)
@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (1.0, 0.0), (1e3, 0.0), (1e3, 1e6)])
def test_a_plane_never_shadows_itself(scale: float, offset: float) -> None:
    """Every surfel faces along its rays: no ray meets any, whatever its start."""
    count = 400
    surfels = raw_surfels(count)
    surfels.centre = scale * torch.cat([torch.randn(count, 2), torch.zeros(count, 1)], -1) + offset
    surfels.rotation = torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(count, 4)
    surfels.log_scale = surfels.log_scale + math.log(scale)
    assert bool((gather_incident(SurfelTracer(surfels), surfels, 16, None).visibility == 1).all())
