"""Cases 36 to 38: visibility, indirect light switched off, and the radiometric fixed point."""

from itertools import pairwise

import pytest
import torch
from torch.nn.functional import normalize

from hard_cases.constructions import cast, facing, looking_along_z, raw_surfels, seeded, two_balls, unit, with_radiance
from radiogs.consistency import RadiometricConsistency
from radiogs_core.kernels.shade.shade import shade
from radiogs_core.kernels.trace.trace import Hits
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.incident import Incident
from radiogs_core.transport.sampling import hemisphere_directions, random_hemisphere_direction
from radiogs_core.transport.splatting import DIFFUSE_DIRECT, shade_surfels, towards
from radiogs_core.transport.tracer import SurfelTracer, gather_incident, visibility_of
from reference.shade import shade as dense_shade
from reference.trace import harmonics

F64 = torch.float64


@pytest.mark.case(36)
def test_transmittance_through_none_one_and_many_is_the_product() -> None:
    for count in (0, 1, 2, 5, 12):
        given = with_radiance(facing(torch.linspace(2, 3, count), 0.2 * torch.rand(count) + 0.05), 1)
        ray = {
            "origin": torch.zeros(1, 3), "direction": torch.tensor([[0.0, 0.0, 1.0]]), "t_min": torch.zeros(1),
        }  # fmt: skip
        exact = float(torch.prod(1 - given["opacity"].double()))
        found = float(cast(given, ray)[1])
        assert found == pytest.approx(exact, abs=1e-6)
        assert 0 <= found <= 1


@pytest.mark.case(36)
def test_a_wall_with_a_hole_lets_light_through_the_hole_alone() -> None:
    """Opaque surfels on a grid but for its middle: V is 0 on the wall and 1 through the hole."""
    place = torch.arange(-3.0, 4.0)
    x, y = torch.meshgrid(place, place, indexing="ij")
    kept = (x.abs() + y.abs() > 0.5).flatten()
    wall = facing(torch.full((int(kept.sum()),), 2.0), 1.0, scale=0.15)
    wall["centre"] = torch.stack([x.flatten()[kept], y.flatten()[kept], torch.full_like(x.flatten()[kept], 2.0)], -1)
    rays = {
        "origin": torch.stack([x.flatten(), y.flatten(), torch.zeros(49)], -1),
        "direction": torch.tensor([0.0, 0.0, 1.0]).expand(49, 3), "t_min": torch.zeros(49),
    }  # fmt: skip
    _, transmittance, _, _ = cast(with_radiance(wall, 1), rays)
    found = Hits(torch.zeros(49, 3), transmittance, torch.zeros(49, 0), torch.zeros(49))
    assert torch.equal(visibility_of(found)[0], (~kept).float())


@pytest.mark.case(36)
def test_adding_an_occluder_never_makes_a_light_brighter() -> None:
    """V after each of twelve more surfels, in random places: in [0, 1] and falling, also across the stop at 3 %."""
    count = 12
    given = with_radiance(facing(2 + torch.rand(count), torch.rand(count)), 1)
    ray = {"origin": torch.zeros(1, 3), "direction": torch.tensor([[0.0, 0.0, 1.0]]), "t_min": torch.zeros(1)}
    seen = []
    for kept in range(count + 1):
        _, transmittance, _, _ = cast({name: value[:kept] for name, value in given.items()}, ray)
        seen.append(float(visibility_of(Hits(torch.zeros(1, 3), transmittance, torch.zeros(1, 0), ray["t_min"]))[0]))
    assert seen[0] == 1
    assert seen[-1] == 0
    assert all(0 <= later <= earlier for earlier, later in pairwise(seen))


@pytest.mark.case(37)
def test_surfels_that_send_no_light_are_indirect_light_switched_off() -> None:
    """The same directions: the direct parts agree bit for bit, and nothing indirect is left."""
    surfels = two_balls()
    tracer = SurfelTracer(surfels)
    incident = gather_incident(tracer, surfels, 16, None)
    assert float(incident.radiance.max()) > 0.1
    dark = Surfels.of(surfels.parameters() | {"sh": torch.full_like(surfels.sh, 0.0)})
    dark.sh[:, 0] = -0.5 / 0.28209479177387814 - 1e-3  # below zero: it is clamped there
    switched = Incident(
        incident.direction, incident.weight, incident.visibility, torch.zeros_like(incident.radiance)
    )  # fmt: skip
    without = gather_incident(SurfelTracer(dark), dark, 16, None)
    camera, environment = looking_along_z(), torch.rand(8, 16, 3)
    outgoing = towards(camera, surfels)[:, None]
    off = shade_surfels(surfels, surfels.albedo, switched, outgoing, environment)
    assert torch.equal(shade_surfels(dark, dark.albedo, without, outgoing, environment), off)
    lit = shade_surfels(surfels, surfels.albedo, incident, outgoing, environment)
    assert torch.equal(lit[:, :, [0, 2]], off[:, :, [0, 2]])
    assert bool((off[:, :, [1, 3]] == 0).all())
    assert float((lit[:, :, 1] - off[:, :, 1]).max()) > 1e-3


@pytest.mark.case(38)
@pytest.mark.parametrize("environment", [1.0, 0.3])
def test_the_radiometric_residual_vanishes_where_radiance_solves_the_light_equation(environment: float) -> None:
    """The harmonics are solved for the reflected light that the dense reference computes in both directions."""
    surfels, camera = raw_surfels(12, torch.float64, spread=2.0), looking_along_z(dtype=F64)
    index, samples = torch.arange(12), 16
    light = torch.full((4, 8, 3), environment, dtype=F64)
    surfels.sh = torch.zeros_like(surfels.sh)
    surfels.sh[:, 0] = -10.0  # black, so that no indirect light moves while the harmonics are being solved
    tracer = SurfelTracer(surfels)
    normal = surfels.frame[..., 2]
    direction, weight = hemisphere_directions(normal, samples, seeded(6))
    random = random_hemisphere_direction(normal, seeded(7))  # the loss's own draw
    outgoing = torch.stack([normalize(camera.centre - surfels.centre, dim=-1), random], 1)
    incident = tracer.incident(index, direction, weight)
    visibility = incident.visibility
    assert float((visibility < 1).double().mean()) > 0.01
    physical = dense_shade(
        normal, surfels.albedo, surfels.roughness, outgoing, direction, weight, visibility,
        torch.zeros(12, samples, 3, dtype=F64), light,
    ).sum(2)  # fmt: skip
    solved = torch.linalg.lstsq(harmonics(-outgoing), physical - 0.5).solution
    assert torch.allclose(harmonics(-outgoing) @ solved + 0.5, physical)
    # Only the residual's own side sees these harmonics: the tracer keeps the black surfels.
    fixed = Surfels.of(surfels.parameters() | {"sh": solved})

    def loss(of: Surfels) -> float:
        return float(RadiometricConsistency().loss(of, light, camera, index, incident, seeded(7)).detach())

    assert loss(fixed) < 1e-10
    off = Surfels.of(surfels.parameters() | {"sh": 1.01 * solved})
    assert loss(off) > 1e-4


@pytest.mark.case(38)
def test_the_squared_residual_pulls_nowhere_at_the_fixed_point() -> None:
    """A white Lambert surface under constant light 1 sends 1: towards the light, its albedo and its normal alike."""
    normal = unit(10).requires_grad_()
    albedo = torch.ones(10, 3, dtype=F64, requires_grad=True)
    environment = torch.ones(4, 8, 3, dtype=F64, requires_grad=True)
    direction, weight = hemisphere_directions(normal.detach(), 64, seeded())
    one = torch.ones(10, 64, dtype=F64)
    parts = shade(
        normal, albedo, torch.ones(10, dtype=F64), normal.detach()[:, None], direction, weight, one,
        torch.zeros(10, 64, 3, dtype=F64), environment,
    )  # fmt: skip
    residual = parts[:, 0, DIFFUSE_DIRECT] - 1
    assert float(residual.detach().abs().max()) < 1e-12
    residual.square().sum().backward()
    assert all(float(leaf.grad.abs().max()) < 1e-10 for leaf in (normal, albedo, environment))  # type: ignore[union-attr]
