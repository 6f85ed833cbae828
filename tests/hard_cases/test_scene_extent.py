"""Cases 21, 23 and 24: scenes of nothing and of too much, and surfaces that are closed or flat."""

import math

import pytest
import torch

from hard_cases.constructions import facing, geometry_of, looking_along_z, raw_surfels, seen, shell
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


@pytest.mark.case(21)
def test_a_training_step_on_surfels_out_of_view_moves_nothing() -> None:
    surfels, camera = raw_surfels(5), looking_along_z()
    surfels.centre = (surfels.centre - torch.tensor([0.0, 0.0, 20.0])).requires_grad_()
    before = surfels.centre.detach().clone()
    optimiser = torch.optim.Adam([surfels.centre], lr=0.1)
    (seen(camera, surfels)[0] - 1).square().mean().backward()
    optimiser.step()
    assert torch.equal(surfels.centre.detach(), before)


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
    """Every surfel of it faces the way that its rays go: no ray meets any, however it starts."""
    count = 400
    surfels = raw_surfels(count)
    surfels.centre = scale * torch.cat([torch.randn(count, 2), torch.zeros(count, 1)], -1) + offset
    surfels.rotation = torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(count, 4)
    surfels.log_scale = surfels.log_scale + math.log(scale)
    assert bool((gather_incident(SurfelTracer(surfels), surfels, 16, None).visibility == 1).all())
