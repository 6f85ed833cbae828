"""The lattice, the baking of occlusion, and reading of both volumes."""

import math

import pytest
import torch

from baselines.methods.gs_ir.world import LATTICE, UPWARDS, baked, closed_form, lit
from baselines.methods.irgs.world import UP, sheet, together
from known_ball import BALL
from radiogs_baselines.methods.gs_ir.training import Reach, bake, corners_near, inherited
from radiogs_baselines.methods.gs_ir.volumes import (
    IrradianceVolume,
    Lattice,
    OcclusionVolume,
    cosine_directions,
    projection,
)
from radiogs_core.surfels.harmonics import COEFFICIENTS, CONSTANT_BASIS
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import sphere_directions

F64 = torch.float64
OPEN = torch.zeros(COEFFICIENTS)
OPEN[0] = 1 / CONSTANT_BASIS
"""Harmonics of M = 1."""


def test_trilinear_weights_reproduce_linear_functions() -> None:
    torch.manual_seed(0)
    position = 1.4 * torch.rand(200, 3) - 0.7
    number, share = LATTICE.around(position)
    torch.testing.assert_close(share.sum(-1), torch.ones(200))
    assert bool((share >= 0).all())
    torch.testing.assert_close((share[..., None] * LATTICE.positions(number)).sum(1), position, rtol=0, atol=1e-6)
    outside = torch.tensor([[9.0, -9.0, 0.0]])
    torch.testing.assert_close(LATTICE.inside(outside), torch.tensor([[0.7, -0.7, 0.0]]))
    assert torch.equal(LATTICE.around(outside)[1], LATTICE.around(LATTICE.inside(outside))[1])


def test_a_lattice_over_surfels_has_a_margin_of_one_cell() -> None:
    lattice = Lattice.over(BALL, 21)
    low, high = BALL.centre.amin(0), BALL.centre.amax(0)
    torch.testing.assert_close(lattice.low + lattice.spacing, low, rtol=0, atol=0.03)
    torch.testing.assert_close(lattice.low + lattice.edge - lattice.spacing, high, rtol=0, atol=0.03)
    assert lattice.of(5).edge == lattice.edge
    assert lattice.of(5).spacing == pytest.approx(5 * lattice.spacing)


def test_one_outlier_in_two_thousand_surfels_does_not_enlarge_the_lattice() -> None:
    many = together(*[BALL] * 6)
    stray = together(many, sheet(500.0, UP, scale=0.1))
    assert Lattice.over(stray, 21).edge == pytest.approx(Lattice.over(many, 21).edge, rel=0.05)


def heights(surfel: Surfels) -> list[float]:
    """Heights of the corners near one surfel."""
    return sorted({round(float(z), 6) for z in LATTICE.positions(corners_near(surfel, LATTICE))[:, 2]})


def test_only_corners_near_a_surfel_are_baked() -> None:
    """A small surfel has eight corners; all other corners read one of their probes."""
    one = sheet(0.0, scale=0.05)
    near = corners_near(one, LATTICE)
    assert float((LATTICE.positions(near).abs() - 0.1).abs().max()) < 1e-6
    assert len(near) == len(baked(one).coefficients) == 8
    probe = inherited(near, LATTICE.corners)
    assert int(probe.min()) == 0
    assert int(probe.max()) == 7
    away = LATTICE.positions(torch.arange(8**3))
    same_side = LATTICE.positions(near)[probe].sign() == away.sign()
    assert bool(same_side.all()), "the nearest by steps along the axes lies on the same side of each"


def test_corners_around_a_surfel_and_its_reading_positions_are_near() -> None:
    """The surfel at 0.05 is read 0.0875 ahead, in the cell above its own; from behind in its own cell. A wide surfel
    reaches 0.35 to both sides along both axes.
    """
    assert heights(sheet(0.05, scale=0.05)) == [-0.1, 0.1, 0.3]
    assert heights(sheet(0.05, (0.0, 0.0, -1.0), scale=0.05)) == [-0.1, 0.1]
    wide = LATTICE.positions(corners_near(sheet(0.0, scale=0.35), LATTICE))
    assert sorted({round(float(x), 6) for x in wide[:, 0]}) == [-0.5, -0.3, -0.1, 0.1, 0.3, 0.5]
    assert sorted({round(float(y), 6) for y in wide[:, 1]}) == [-0.5, -0.3, -0.1, 0.1, 0.3, 0.5]
    upright = sheet(0.0, (1.0, 0.0, 0.0), scale=0.35)
    assert len(heights(upright)) == 6


def test_corners_inherit_the_nearest_probe() -> None:
    """With two probes at the ends of a row, each half reads the nearer one."""
    near = torch.tensor([0, 6])
    probe = inherited(near, 7)[:7]
    assert probe.tolist()[:3] == [0, 0, 0]
    assert probe.tolist()[4:] == [1, 1, 1]


def test_inheritance_counts_grid_steps() -> None:
    """The corner (3, 3, 3) reads (5, 3, 3), two steps away, and not (2, 2, 2), which is nearer in a straight line."""
    near = torch.tensor([(2 * 7 + 2) * 7 + 2, (5 * 7 + 3) * 7 + 3])
    assert int(inherited(near, 7)[(3 * 7 + 3) * 7 + 3]) == 1


def test_the_projection_is_onto_orthonormal_harmonics() -> None:
    """Products summed over the sphere give the identity; M = 1 has only the constant coefficient."""
    direction = sphere_directions(4096)
    onto = projection(direction)
    gram = (onto * len(direction) / (4 * math.pi)).T @ onto
    torch.testing.assert_close(gram, torch.eye(16, dtype=F64), rtol=0, atol=2e-3)
    torch.testing.assert_close(onto.sum(0), OPEN.double(), rtol=0, atol=2e-3)
    torch.testing.assert_close(direction.mean(0), torch.zeros(3, dtype=F64), rtol=0, atol=1e-3)


def test_directions_about_a_normal_are_cosine_distributed() -> None:
    """Moments of the cosine under density cosine / pi are 2/3, 1/2 and 2/5; the mean tangential component is 0."""
    torch.manual_seed(1)
    normal = torch.nn.functional.normalize(torch.randn(5, 3, dtype=F64), dim=-1)
    direction = cosine_directions(normal, 4000)
    cosine = (direction * normal[:, None]).sum(-1)
    assert float(cosine.min()) > 0
    for power, expected in ((1, 2 / 3), (2, 1 / 2), (3, 2 / 5)):
        torch.testing.assert_close(cosine.pow(power).mean(1), torch.full((5,), expected, dtype=F64), rtol=1e-4, atol=0)
    torch.testing.assert_close(direction.mean(1), 2 / 3 * normal, rtol=0, atol=2e-3)


def halves(axis: int) -> OcclusionVolume:
    """A volume that is closed on the lower half of the lattice along one axis, and open on the upper half."""
    upper = LATTICE.positions(torch.arange(8**3))[:, axis] > 0
    return OcclusionVolume(LATTICE, upper.long(), torch.stack([torch.zeros(16), OPEN]))


def test_points_outside_the_cube_read_the_nearest_corners() -> None:
    everywhere = OcclusionVolume(LATTICE, torch.zeros(8**3, dtype=torch.int64), OPEN[None])
    torch.manual_seed(2)
    position = 3 * torch.rand(300, 3) - 1.5
    normal = torch.nn.functional.normalize(torch.randn(300, 3), dim=-1)
    corner = torch.tensor([[0.7, 0.7, 0.7], [-0.7, 0.7, -0.7]])
    outward = torch.nn.functional.normalize(corner, dim=-1)
    found = everywhere.openness(torch.cat([position, corner]), torch.cat([normal, outward]), 16)
    torch.testing.assert_close(found, torch.ones(302))


def test_probe_rays_hit_both_sides_of_surfels() -> None:
    """Seen from below, a floor that faces up occludes as much as one that faces down."""
    upwards, downwards = (baked(sheet(0.0, normal)) for normal in (UP, (0.0, 0.0, -1.0)))
    torch.testing.assert_close(upwards.coefficients, downwards.coefficients, rtol=0, atol=1e-6)
    assert float(upwards.coefficients[:, 2].abs().min()) > 0.1


def test_few_directions_give_nearly_the_same_probe_as_many() -> None:
    floor = sheet(0.0)
    few = float(bake(floor, LATTICE, Reach(tau=0.5), 256).openness(torch.zeros(1, 3), UPWARDS, 32))
    assert few == pytest.approx(closed_form(None), abs=0.02)


def test_irradiance_is_trilinear_in_position_and_of_degree_two_in_the_normal() -> None:
    volume = IrradianceVolume.dark(LATTICE.of(4))
    assert volume.coefficients.shape == (64, 9)
    volume.coefficients[:, 0] = (2 + LATTICE.of(4).positions(torch.arange(64))[:, 0]) / CONSTANT_BASIS
    position = torch.tensor([[0.3, 0.1, -0.2], [-0.55, 0.0, 0.6]])
    torch.testing.assert_close(volume.at(position, UPWARDS.expand(2, 3)), 2 + position[:, 0])
    tilted = lit(1.0)
    tilted.coefficients[:, 2] = 0.5 / math.sqrt(3 / (4 * math.pi))
    normals = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    torch.testing.assert_close(tilted.at(torch.zeros(3, 3), normals), torch.tensor([1.5, 0.5, 1.0]))


def test_volumes_are_restored_from_their_tensors() -> None:
    volume = halves(1)
    back = OcclusionVolume.of(volume.tensors())
    assert torch.equal(back.probe, volume.probe)
    assert torch.equal(back.coefficients, volume.coefficients)
    assert back.lattice.spacing == LATTICE.spacing
    again = IrradianceVolume.of(lit(0.3).tensors())
    assert torch.equal(again.coefficients, lit(0.3).coefficients)
    assert again.lattice.corners == 5
