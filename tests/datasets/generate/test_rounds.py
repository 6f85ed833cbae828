"""Solids of revolution and reliefs: closed meshes that face outwards, samples on the surface, and what is inside."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from radiogs_datasets.generate import RECIPES, rounds
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import GAP, Box, Relief, Swell, Turned
from radiogs_datasets.generate.surfaces import surfaces_of
from reference.solids import profile_curve, relief_height, relief_radius

GREY = Material((0.5, 0.5, 0.5), 0.5)
CUP = Turned(
    (0.1, -0.2, 0.3), ((0.05, 0.0), (0.2, 0.0), (0.22, 0.02), (0.4, 0.4), (0.4, 0.44), (0.36, 0.42), (0.1, 0.08)), GREY
)
STONE = Relief(
    (0.1, -0.2, 0.3), 0.5, (Swell(40.0, 30.0, 8.0, 0.5), Swell(200.0, -10.0, 10.0, -0.3)), 0.02, 0.6, 0.25, 3, GREY
)
BOTH = pytest.mark.parametrize("solid", [CUP, STONE], ids=["turned", "relief"])


def facets(solid: Turned | Relief) -> tuple[torch.Tensor, torch.Tensor]:
    """The triangles' vertices relative to the centre [triangles, 3, 3], and normals as long as twice their areas."""
    vertices, triangles = rounds.mesh(solid)
    corners = vertices[triangles] - torch.tensor(solid.centre).double()
    return corners, torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@BOTH
def test_each_edge_of_a_mesh_belongs_to_two_triangles_that_run_along_it_oppositely(
    solid: Turned | Relief, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rounds, "ROWS_PER_POINT", 3)
    monkeypatch.setattr(rounds, "COLUMNS", 8)
    monkeypatch.setattr(rounds, "RELIEF_MESH", (9, 8))
    vertices, triangles = rounds.mesh(solid)
    edges = [(int(one[a]), int(one[b])) for one in triangles for a, b in ((0, 1), (1, 2), (2, 0))]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    assert set(triangles.flatten().tolist()) == set(range(len(vertices)))
    assert len(vertices) - len(edges) // 2 + len(triangles) == 2  # Euler: a sphere's


def test_a_turned_mesh_has_the_volume_and_the_area_that_its_profile_sweeps() -> None:
    curve, _ = profile_curve(CUP, 20_000)
    steps, middle = np.diff(curve, axis=0), (curve[1:] + curve[:-1]) / 2
    corners, normal = facets(CUP)
    volume = math.pi * (middle[:, 0] ** 2 * steps[:, 1]).sum()
    assert float((corners[:, 0] * normal).sum() / 6) == pytest.approx(volume, rel=1e-3)
    area = 2 * math.pi * (middle[:, 0] * np.linalg.norm(steps, axis=-1)).sum()
    assert float(normal.norm(dim=-1).sum() / 2) == pytest.approx(area, rel=1e-3)
    assert float(surfaces_of([CUP], 0.02).size.prod(-1).sum()) == pytest.approx(area, rel=1e-3)


def test_a_relief_has_the_volume_of_its_radii_and_its_cells_the_area_of_its_mesh() -> None:
    corners, normal = facets(STONE)
    direction = np.random.default_rng(0).normal(size=(20_000, 3))
    radius = relief_radius(STONE, direction / np.linalg.norm(direction, axis=-1, keepdims=True))
    assert float((corners[:, 0] * normal).sum() / 6) == pytest.approx(4 / 3 * math.pi * (radius**3).mean(), rel=0.02)
    area = float(normal.norm(dim=-1).sum() / 2)
    assert float(surfaces_of([STONE], 0.02).size.prod(-1).sum()) == pytest.approx(area, rel=1e-3)


def heights(solid: Turned | Relief, offset: np.ndarray) -> np.ndarray:
    """Above the surface near it, of points relative to the centre: from the profile's curve, or along the radius."""
    if isinstance(solid, Relief):
        return relief_height(solid, offset)
    curve, outwards = profile_curve(solid, 50_000)
    flat = np.stack([np.linalg.norm(offset[:, :2], axis=-1), offset[:, 2]], -1)
    _, place = cKDTree(curve).query(flat)
    return ((flat - curve[place]) * outwards[place]).sum(-1)


def slopes(solid: Turned | Relief, offset: np.ndarray) -> np.ndarray:
    """Unit directions in which the height grows, by finite differences."""
    steps = 1e-4 * np.eye(3)
    slope = np.stack([heights(solid, offset + step) - heights(solid, offset - step) for step in steps], -1)
    return slope / np.linalg.norm(slope, axis=-1, keepdims=True)


@BOTH
@pytest.mark.parametrize("spacing", [0.1, 0.03])
def test_samples_lie_on_the_surface_and_face_where_its_height_grows(solid: Turned | Relief, spacing: float) -> None:
    samples = surfaces_of([solid], spacing)
    offset = samples.centre.numpy() - solid.centre
    assert np.abs(heights(solid, offset)).max() < 1e-6
    assert samples.centre.dtype == samples.frame.dtype == samples.size.dtype == torch.float64
    assert float((samples.frame.mT @ samples.frame - torch.eye(3).double()).abs().max()) < 1e-12
    assert (slopes(solid, offset) * samples.frame[..., 2].numpy()).sum(-1).min() > math.cos(math.radians(0.5))
    assert float(samples.size.max()) <= spacing * 1.001


@BOTH
def test_a_step_along_a_cells_axes_stays_on_the_surface(solid: Turned | Relief) -> None:
    samples = surfaces_of([solid], 0.03)
    for axis in (0, 1):
        step = 1e-3 * samples.frame[..., axis]
        off = heights(solid, (samples.centre + step).numpy() - solid.centre)
        assert np.abs(off).max() < 2e-5  # the square of the step, times curvatures of up to 40


@BOTH
def test_the_triangles_lie_on_the_surface_and_face_where_its_height_grows(solid: Turned | Relief) -> None:
    corners, normal = (each[::97] for each in facets(solid))
    middle = corners.mean(1).numpy()
    assert np.abs(heights(solid, middle)).max() < 2e-4
    unit = torch.nn.functional.normalize(normal, dim=-1).numpy()
    assert (slopes(solid, middle) * unit).sum(-1).min() > math.cos(math.radians(4))


@BOTH
@pytest.mark.parametrize("margin", [0.0, 0.02])
def test_what_is_below_the_surface_is_inside(solid: Turned | Relief, margin: float) -> None:
    at = np.random.default_rng(0).uniform(-0.8, 0.8, (20_000, 3)) + solid.centre
    offset = at - np.array(solid.centre)
    found = rounds.inside(solid, torch.from_numpy(at), margin).numpy()
    if isinstance(solid, Relief):
        height = relief_height(solid, offset)
        # To first order a slope of s makes the distance 1 / sqrt(1 + s^2) of the height.
        assert found[height < margin].all()
        assert not found[height > 3 * margin + 1e-9].any()
    else:
        curve, outwards = profile_curve(solid, 20_000)
        flat = np.stack([np.linalg.norm(offset[:, :2], axis=-1), offset[:, 2]], -1)
        distance, place = cKDTree(curve).query(flat)
        below = ((flat - curve[place]) * outwards[place]).sum(-1) < 0
        clear = np.abs(np.where(below, -distance, distance) - margin) > 1e-4
        assert np.array_equal(found[clear], (below | (distance < margin))[clear])
    assert 300 < found.sum() < 8000
    assert not rounds.inside(solid, torch.from_numpy(at[:0]), margin).numel()


def test_the_bottom_of_a_cup_is_no_part_of_its_inside() -> None:
    """A point in its hollow is outside, one in its wall inside."""
    hollow, wall = (0.1, -0.2, 0.3 + 0.3), (0.1, -0.2, 0.3 + 0.04)
    assert rounds.inside(CUP, torch.tensor([hollow, wall]).double(), 0.0).tolist() == [False, True]


def test_a_floor_is_not_sampled_where_a_cup_stands_on_it() -> None:
    low = CUP.centre[2] - GAP
    floor = Box((-1.0, -1.0, low - 0.1), (1.0, 1.0, low), GREY)
    alone, under = (surfaces_of(solids, 0.02).centre for solids in ([floor], [floor, CUP]))
    covered = int((alone[:, 2] == low).sum() - (under[:, 2] == low).sum())
    assert 0.5 < covered * 0.02**2 / (math.pi * 0.2**2) < 1.2


TURNED = [solid for recipe in RECIPES.values() for solid in recipe.solids if isinstance(solid, Turned)]


def test_walls_of_vessels_are_about_as_thick_as_a_pixel_and_no_profile_meets_itself_or_its_axis() -> None:
    assert len(TURNED) > 8
    for solid in TURNED:
        curve, outwards = profile_curve(solid, 700)
        assert curve[1:-1, 0].min() > 0
        along = np.concatenate([[0.0], np.linalg.norm(np.diff(curve, axis=0), axis=-1).cumsum()])
        apart = np.linalg.norm(curve[:, None] - curve, axis=-1)
        behind = (outwards[:, None] * outwards).sum(-1) < 0
        assert apart[behind & (np.abs(along[:, None] - along) > 0.1)].min() > 0.018


def test_reliefs_have_one_surface_in_every_direction() -> None:
    reliefs = [solid for recipe in RECIPES.values() for solid in recipe.solids if isinstance(solid, Relief)]
    assert len(reliefs) >= 3
    direction = np.random.default_rng(1).normal(size=(20_000, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    for solid in reliefs:
        expected = relief_radius(solid, direction)
        assert expected.min() > 0.3 * solid.radius
        found, _ = rounds.radii(solid, torch.from_numpy(direction))
        np.testing.assert_allclose(found.numpy(), expected, atol=1e-12)
