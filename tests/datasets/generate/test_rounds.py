"""Surfaces of generated scenes: vessels, reliefs, the trefoil, and the patterns on them."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from radiogs_datasets.generate import RECIPES, rounds, trefoil
from radiogs_datasets.generate.materials import Material, Patterned
from radiogs_datasets.generate.patterns import GLYPHS, Checker, Noise, Pattern, Print, Rings, Stripes, segments
from radiogs_datasets.generate.solids import GAP, Box, Knot, Relief, Swell, Turned
from radiogs_datasets.generate.surfaces import surfaces_of
from reference.solids import knot_curve, profile_curve, relief_height, relief_radius

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
def test_points_below_the_surface_are_inside(solid: Turned | Relief, margin: float) -> None:
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


KNOT = Knot((0.1, -0.2, 0.3), 0.44, 0.24, 0.155, GREY)


@pytest.fixture(scope="module")
def curve() -> np.ndarray:
    return knot_curve(KNOT, 50_000)


@pytest.fixture(scope="module")
def length(curve: np.ndarray) -> float:
    return float(np.linalg.norm(curve - np.roll(curve, 1, 0), axis=-1).sum())


@pytest.fixture(scope="module")
def corners() -> torch.Tensor:
    """The triangles' vertices, [triangles, 3, 3]."""
    vertices, triangles = trefoil.mesh(KNOT, 512, 96)
    return vertices[triangles]


def normals_of(corners: torch.Tensor) -> torch.Tensor:
    """Normals of triangles, as long as twice their areas."""
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_each_edge_of_the_mesh_belongs_to_two_triangles_that_run_along_it_oppositely() -> None:
    vertices, triangles = trefoil.mesh(KNOT, 40, 12)
    edges = [(int(one[a]), int(one[b])) for one in triangles for a, b in ((0, 1), (1, 2), (2, 0))]
    assert len(set(edges)) == len(edges) == 3 * 2 * 40 * 12
    assert {(b, a) for a, b in edges} == set(edges)
    assert set(triangles.flatten().tolist()) == set(range(len(vertices)))


def test_the_mesh_faces_outwards_and_encloses_the_volume_of_a_tube(corners: torch.Tensor, length: float) -> None:
    volume = float((corners[:, 0] * normals_of(corners)).sum() / 6)
    assert volume == pytest.approx(math.pi * KNOT.radius**2 * length, rel=0.005)
    area = float(normals_of(corners).norm(dim=-1).sum() / 2)
    assert area == pytest.approx(2 * math.pi * KNOT.radius * length, rel=0.003)


def test_the_normals_of_the_tube_agree_with_its_triangles(corners: torch.Tensor) -> None:
    """Also that the tube does not meet itself: each triangle looks away from the nearest point of the curve."""
    middle = corners.mean(1)
    distance, place = cKDTree(knot_curve(KNOT, 20_000)).query(middle.numpy())
    outwards = (middle - torch.from_numpy(knot_curve(KNOT, 20_000)[place])) / torch.from_numpy(distance)[:, None]
    cosine = (outwards * torch.nn.functional.normalize(normals_of(corners), dim=-1)).sum(-1)
    assert float(cosine.min()) > math.cos(math.radians(180 / 96 + 1.5))
    assert distance.max() < KNOT.radius + 1e-9
    assert distance.min() > KNOT.radius * 0.998


@pytest.mark.parametrize("spacing", [0.2, 0.05])
def test_samples_lie_on_the_tube_face_outwards_and_have_its_area(
    spacing: float, curve: np.ndarray, corners: torch.Tensor
) -> None:
    samples = surfaces_of([KNOT], spacing)
    distance, place = cKDTree(curve).query(samples.centre.numpy())
    np.testing.assert_allclose(distance, KNOT.radius, atol=1e-6)
    outwards = (samples.centre.numpy() - curve[place]) / distance[:, None]
    assert (outwards * samples.frame[..., 2].numpy()).sum(-1).min() > 1 - 1e-5
    area = float(normals_of(corners).norm(dim=-1).sum() / 2)
    assert float(samples.size.prod(-1).sum()) == pytest.approx(area, rel=0.01)
    assert float(samples.size.max()) <= spacing * 1.001


def test_cells_of_samples_reach_from_one_to_the_next() -> None:
    """A step along a frame's axes by a cell's size leads to the middle of a neighbouring cell, nearly."""
    samples = surfaces_of([KNOT], 0.02)
    tree = cKDTree(samples.centre.numpy())
    around = samples.centre + samples.frame[..., 0] * samples.size[:, :1]
    assert tree.query(around.numpy())[0].max() < 0.1 * 0.02
    along = samples.centre + samples.frame[..., 1] * samples.size[:, 1:]
    # The grid is sheared: what is half a cell beside the step is the farthest that the nearest middle can be.
    assert tree.query(along.numpy())[0].max() < 0.6 * 0.02
    assert float(samples.size[:, 0].min()) > 0.019


def test_cells_are_smaller_on_the_inside_of_a_bend() -> None:
    """Radius times stretch is the area per unit of the parameters, as differences between nearby points have it."""
    t, s = trefoil.grid(30, 12)
    by_t, by_s = (
        (trefoil.points(KNOT, t + a, s + b) - trefoil.points(KNOT, t - a, s - b)) / 2e-5
        for a, b in ((1e-5, 0.0), (0.0, 1e-5))
    )
    expected = torch.linalg.cross(by_t, by_s).norm(dim=-1)
    torch.testing.assert_close(KNOT.radius * trefoil.stretch(KNOT, t, s), expected, rtol=1e-7, atol=0)
    assert float(expected.max() / expected.min()) > 1.5


def test_points_within_the_radius_of_the_curve_are_inside() -> None:
    at = torch.from_numpy(np.random.default_rng(0).uniform(-1.1, 1.1, (20_000, 3)))
    distance = torch.from_numpy(cKDTree(knot_curve(KNOT, 20_000)).query(at.numpy())[0])
    for margin in (0.0, 0.05):
        found = trefoil.inside(KNOT, at, margin)
        assert torch.equal(found, distance < KNOT.radius + margin)
        assert 500 < int(found.sum()) < 5000
    assert not trefoil.inside(KNOT, at[:0], 0.0).numel()


def test_a_floor_is_not_sampled_where_the_tube_rests_on_it() -> None:
    low = KNOT.centre[2] - KNOT.swing - KNOT.radius - GAP
    floor = Box((-1.0, -1.0, low - 0.1), (1.0, 1.0, low), GREY)
    alone, under = (surfaces_of(solids, 0.01).centre for solids in ([floor], [floor, KNOT]))
    covered = int((alone[:, 2] == low).sum() - (under[:, 2] == low).sum())
    # The tube is lowest at three places, and nearer than 1.5 gaps to the floor only around them.
    assert 3 < covered < 100


PATTERNS: dict[str, Pattern] = {
    "checker": Checker(0.25, (0.03, 0.07, -0.9)),
    "stripes": Stripes((0.0, 0.6, 0.8), 0.3, 0.4),
    "rings": Rings((0.2, -0.3, 0.3), 0.16, 0.5),
    "noise": Noise(0.7, 0.15, 0.8, 3),
    "print": Print("RADIO", (-0.55, -0.85, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.3, 0.06),
}


def share(pattern: Pattern, points: list[tuple[float, float, float]] | np.ndarray) -> np.ndarray:
    return pattern.share(*np.array(points, dtype=np.float64).reshape(-1, 3).T, np)


@pytest.fixture
def cloud() -> np.ndarray:
    return np.random.default_rng(0).uniform(-1.2, 1.2, (20_000, 3))


@pytest.mark.parametrize("name", PATTERNS)
def test_torch_and_numpy_evaluate_the_same_pattern_between_zero_and_one(name: str, cloud: np.ndarray) -> None:
    expected = share(PATTERNS[name], cloud)
    found = PATTERNS[name].share(*torch.from_numpy(cloud).unbind(-1), torch)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-12)
    assert expected.min() == 0
    assert expected.max() == 1


def test_checker_changes_from_each_cube_to_its_neighbours() -> None:
    pattern = Checker(0.5, (0.1, 0.2, 0.3))
    inner = (0.2, 0.3, 0.4)
    steps = [(0, 0, 0), (0.5, 0, 0), (0, 0.5, 0), (0, 0, -0.5), (0.5, 0.5, 0), (0.5, 0.5, 0.5), (-1, 0, 0)]
    assert share(pattern, [tuple(np.add(inner, step)) for step in steps]).tolist() == [0, 1, 1, 1, 0, 1, 0]


def test_stripes_fill_their_duty_of_each_period_and_are_even_across() -> None:
    pattern = Stripes((0.0, 0.6, 0.8), 0.3, 0.4)
    along = np.arange(-3000, 3000)[:, None] / 10_000 * np.array([0.0, 0.6, 0.8])
    assert share(pattern, along).mean() == pytest.approx(0.4, abs=1e-3)
    assert share(pattern, [(0.0, 0.6 * 0.17, 0.8 * 0.17), (0.0, 0.6 * 0.19, 0.8 * 0.19)]).tolist() == [0, 1]
    sideways = np.array([[0.9, 0.0, 0.0], [-0.4, 0.8, -0.6], [0.0, -1.6, 1.2]])
    for middle, value in ((0.1, 0), (0.25, 1)):
        assert share(pattern, sideways + middle * np.array([0.0, 0.6, 0.8])).tolist() == [value] * 3


def test_rings_depend_on_the_distance_alone() -> None:
    pattern = Rings((0.2, -0.3, 0.3), 0.16, 0.25)
    ways = np.random.default_rng(1).normal(size=(50, 3))
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    for distance, value in ((0.05, 0), (0.11, 0), (0.13, 1), (0.17, 0), (0.27, 0), (0.29, 1)):
        assert set(share(pattern, np.array(pattern.centre) + distance * ways)) == {value}


def test_noise_has_the_variance_and_the_wavelengths_that_it_states_and_depends_on_its_seed() -> None:
    wide = np.random.default_rng(2).uniform(-40, 40, (200_000, 3))
    field = share(Noise(0.8, 0.2, 0.01, 5), wide) - 0.5  # so little contrast that nothing is clipped
    assert field.mean() == pytest.approx(0, abs=2e-4)
    assert field.std() == pytest.approx(0.01, rel=0.02)
    nearby = share(Noise(0.8, 0.2, 0.01, 5), wide + np.array([0.02, 0.0, 0.0])) - 0.5
    assert np.corrcoef(field, nearby)[0, 1] > 0.9
    elsewhere = share(Noise(0.8, 0.2, 0.01, 5), wide + np.array([7.3, 2.1, 5.9]))
    assert abs(np.corrcoef(field, elsewhere)[0, 1]) < 0.5
    assert abs(np.corrcoef(field, share(Noise(0.8, 0.2, 0.01, 6), wide))[0, 1]) < 0.5


def test_noise_is_the_same_field_for_ever() -> None:
    """The committed ``niche`` was rendered with this one, at a larger contrast."""
    found = share(Noise(0.9, 0.25, 0.1, 1), [(0.1, 0.2, 0.3), (-0.5, 0.4, 0.0), (0.0, -0.7, 0.5)])
    np.testing.assert_allclose(found, [0.305003815, 0.589421894, 0.440134255], atol=1e-8)


def test_ink_covers_strokes_of_its_thickness_and_nothing_else() -> None:
    """A letter I: a vertical stroke between (10) and (14) of a grid 0.3 heights wide."""
    pattern = Print("I", (1.0, 2.0, 3.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), 0.5, 0.1)
    stroke = 2.0 + 0.3 * 0.5
    inked = [
        (9.0, stroke, 3.2),
        (1.0, stroke + 0.049, 3.2),
        (1.0, stroke, 3.5 + 0.049),
        (1.0, stroke - 0.04, 3.0 - 0.02),
    ]
    blank = [(1.0, stroke + 0.051, 3.2), (1.0, stroke, 3.551), (1.0, stroke - 0.04, 3.0 - 0.04), (1.0, 2.0, 3.2)]
    assert share(pattern, inked).tolist() == [1] * 4
    assert share(pattern, blank).tolist() == [0] * 4


def test_letters_differ_and_stand_side_by_side() -> None:
    assert len({tuple(segments(letter)) for letter in GLYPHS}) == len(GLYPHS)
    ends = np.array([segments("RAD")]).reshape(-1, 2)
    assert ends[:, 1].min() == 0
    assert ends[:, 1].max() == 1
    first, second = (max(x for stroke in segments(text) for x, _ in stroke) for text in ("R", "RA"))
    assert min(x for stroke in segments("RA")[len(segments("R")) :] for x, _ in stroke) - first == pytest.approx(0.35)
    assert second == pytest.approx(2 * 0.6 + 0.35)
    with pytest.raises(ValueError, match="no strokes for Z in the text 'ZOO'"):
        segments("ZOO")


def test_a_patterned_finish_goes_from_its_first_material_to_its_second() -> None:
    first, second = Material((0.1, 0.2, 0.3), 0.8), Material((0.5, 0.4, 0.7), 0.2)
    finish = Patterned(first, second, Checker(1.0, (0.0, 0.0, 0.0)))
    values = np.stack(finish.at(*np.array([[0.5, 1.5], [0.5, 0.5], [0.5, 0.5]]), np), -1)
    np.testing.assert_allclose(values, [[0.1, 0.2, 0.3, 0.8], [0.5, 0.4, 0.7, 0.2]])
    black = np.stack(finish.without_diffuse().at(*np.array([[0.5, 1.5], [0.5, 0.5], [0.5, 0.5]]), np), -1)
    np.testing.assert_allclose(black, [[0, 0, 0, 0.8], [0, 0, 0, 0.2]])


@pytest.mark.parametrize("name", ["niche", "knot", "print"])
def test_albedo_and_roughness_vary_over_what_the_patterned_scenes_show(name: str) -> None:
    patterned = [solid.material for solid in RECIPES[name].solids if isinstance(solid.material, Patterned)]
    assert len(patterned) >= 3
    for finish in patterned:
        assert math.dist(finish.first.albedo, finish.second.albedo) > 0.1
    assert sum(abs(finish.first.roughness - finish.second.roughness) >= 0.3 for finish in patterned) >= 2
