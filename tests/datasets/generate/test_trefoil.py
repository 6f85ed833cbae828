"""The knotted tube: its mesh is closed and faces outwards, its samples lie on it, and its inside is inside."""

import math

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from radiogs_datasets.generate import trefoil
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import GAP, Box, Knot
from radiogs_datasets.generate.surfaces import surfaces_of
from reference.solids import knot_curve

GREY = Material((0.5, 0.5, 0.5), 0.5)
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


def facets(corners: torch.Tensor) -> torch.Tensor:
    """Normals of triangles, as long as twice their areas."""
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_each_edge_of_the_mesh_belongs_to_two_triangles_that_run_along_it_oppositely() -> None:
    vertices, triangles = trefoil.mesh(KNOT, 40, 12)
    edges = [(int(one[a]), int(one[b])) for one in triangles for a, b in ((0, 1), (1, 2), (2, 0))]
    assert len(set(edges)) == len(edges) == 3 * 2 * 40 * 12
    assert {(b, a) for a, b in edges} == set(edges)
    assert set(triangles.flatten().tolist()) == set(range(len(vertices)))


def test_the_mesh_faces_outwards_and_encloses_the_volume_of_a_tube(corners: torch.Tensor, length: float) -> None:
    volume = float((corners[:, 0] * facets(corners)).sum() / 6)
    assert volume == pytest.approx(math.pi * KNOT.radius**2 * length, rel=0.005)
    area = float(facets(corners).norm(dim=-1).sum() / 2)
    assert area == pytest.approx(2 * math.pi * KNOT.radius * length, rel=0.003)


def test_the_normals_of_the_tube_are_those_of_its_triangles(corners: torch.Tensor) -> None:
    """Also that the tube does not meet itself: each triangle looks away from the nearest point of the curve."""
    middle = corners.mean(1)
    distance, place = cKDTree(knot_curve(KNOT, 20_000)).query(middle.numpy())
    outwards = (middle - torch.from_numpy(knot_curve(KNOT, 20_000)[place])) / torch.from_numpy(distance)[:, None]
    cosine = (outwards * torch.nn.functional.normalize(facets(corners), dim=-1)).sum(-1)
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
    area = float(facets(corners).norm(dim=-1).sum() / 2)
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


def test_what_is_nearer_to_the_curve_than_the_radius_is_inside() -> None:
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
