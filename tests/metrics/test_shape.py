"""Errors of shape: normals, depth, and distances between surfaces."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista
import torch

from radiogs_bench.scoring.metrics.conventions import DepthOffset, Normal
from radiogs_bench.scoring.metrics.geometry import angle, depth_offset, normal_mae
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.metrics.surface_distance import (
    distance_from_cells,
    distance_from_mesh,
    distance_from_points,
    points_in_cells,
    sampled_surface,
    surface_distance,
)
from radiogs_bench.scoring.true_shape import read_mesh, true_shape
from radiogs_core.errors import DataError
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.generate.catalogue import RECIPES
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from radiogs_datasets.generate.surfaces import surfaces_of

IMAGE = Normal(region="image")


def towards(*, degrees: float, size: int = 4) -> torch.Tensor:
    radians = math.radians(degrees)
    direction = torch.tensor([math.sin(radians), 0.0, math.cos(radians)], dtype=torch.float64)
    return direction.expand(size, size, 3).clone()


@pytest.mark.parametrize("degrees", [0.0, 1e-5, 1e-3, 0.05, 30, 90, 179.999, 180])
@pytest.mark.parametrize("length", [1e-3, 1.0, 7.0])
def test_the_angle_is_exact_from_identical_to_anti_parallel(degrees: float, length: float) -> None:
    found = angle(length * towards(degrees=degrees), towards(degrees=0.0))
    assert (found - degrees).abs().max() < math.degrees(1e-6)


def test_identical_float32_normals_are_at_no_angle() -> None:
    """Clamped arccos of their dot products would give 0.002 degrees, and unclamped NaN."""
    normal = torch.nn.functional.normalize(torch.randn(50, 50, 3), dim=-1)
    assert angle(normal, normal).max() < 1e-6


def test_a_whole_image_counts_the_background_as_right() -> None:
    """8 degrees in a 25 % mask are 2 degrees over the image."""
    target, normal, mask = torch.zeros(4, 4, 3), torch.zeros(4, 4, 3), torch.zeros(4, 4, 1)
    mask[:2, :2] = 1
    target[:2, :2], normal[:2, :2] = towards(degrees=20, size=2).float(), towards(degrees=28, size=2).float()
    assert normal_mae(normal, target, mask, mask) == pytest.approx(8, abs=1e-5)
    assert normal_mae(normal, target, mask, mask, IMAGE) == pytest.approx(2, abs=1e-5)


def test_floaters_count_by_their_own_coverage_but_not_by_the_truths() -> None:
    target, mask = towards(degrees=0), torch.ones(4, 4, 1)
    mask[2:] = 0
    normal = towards(degrees=0)
    normal[2:] = torch.tensor([1.0, 0.0, 0.0])
    alpha = torch.ones(4, 4, 1)
    assert normal_mae(normal, target, mask, alpha, IMAGE) == pytest.approx(45)
    by_truth = Normal(region="image", blended_by="true coverage")
    assert normal_mae(normal, target, mask, alpha, by_truth) == pytest.approx(0, abs=1e-6)


def test_a_silhouette_is_blended_halfway_to_the_background() -> None:
    """(1, 0, 0) at half coverage over (0, 0, 1) makes 45 degrees."""
    sideways = torch.tensor([1.0, 0.0, 0.0]).expand(2, 2, 3)
    half, full = torch.full((2, 2, 1), 0.5), torch.ones(2, 2, 1)
    assert normal_mae(sideways, sideways, full, half, IMAGE) == pytest.approx(45)


def test_holes_count_ninety_where_they_are_covered() -> None:
    target, normal, mask = towards(degrees=0), towards(degrees=0), torch.ones(4, 4, 1)
    normal[0] = 0
    assert normal_mae(normal, target, mask) == pytest.approx(22.5)
    alpha = torch.ones(4, 4, 1)
    assert normal_mae(normal, target, mask, alpha, IMAGE) == pytest.approx(22.5)
    alpha[0] = 0  # neither normal nor coverage: the background stands there
    assert normal_mae(normal, target, mask, alpha, IMAGE) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("rules", [Normal(), IMAGE, Normal(region="image", blended_by="true coverage")])
def test_nan_outside_the_mask_does_not_leak_and_an_empty_mask_has_no_figure(rules: Normal) -> None:
    target, normal, mask = towards(degrees=0), towards(degrees=10), torch.ones(4, 4, 1)
    mask[0], normal[0], target[0] = 0, math.nan, math.nan
    assert math.isfinite(normal_mae(normal, target, mask, mask, rules))
    assert math.isnan(normal_mae(normal, target, torch.zeros(4, 4, 1), mask, rules))


def test_eight_bits_cost_a_fifth_of_a_degree() -> None:
    normal = torch.nn.functional.normalize(torch.randn(60, 60, 3), dim=-1)
    mask = torch.ones(60, 60, 1)
    rounded = normal_mae(normal, normal, mask, mask, Normal(region="image", prediction_bits="8 bit rounded"))
    assert rounded == pytest.approx(0.17, abs=0.02)


def test_a_protocol_gives_an_empty_mask_as_reason() -> None:
    found = protocol("default").score_normal(towards(degrees=0), towards(degrees=0), torch.zeros(4, 4, 1))["mae"]
    assert (found.value, found.reason) == (None, "the mask is empty")


RULES = DepthOffset()
TRUTH = torch.tensor([[2.0, 3.0], [4.0, 5.0]])[..., None]
MASK = torch.tensor([[1.0, 0.6], [0.4, 0.0]])[..., None]


def test_the_mean_distance_inside_the_mask_in_percent_of_the_extent() -> None:
    found = TRUTH + torch.tensor([[0.1, -0.3], [9.0, 9.0]])[..., None]
    assert depth_offset(found, TRUTH, MASK, 2.0, RULES) == pytest.approx(100 * 0.2 / 2, rel=1e-6)


def test_a_factor_is_an_error_here_and_an_empty_pixel_the_whole_distance() -> None:
    assert depth_offset(2 * TRUTH, TRUTH, MASK, 1.0, RULES) == pytest.approx(250.0)
    assert depth_offset(0 * TRUTH, TRUTH, MASK, 1.0, RULES) == pytest.approx(250.0)


def test_without_a_covered_pixel_there_is_no_value() -> None:
    assert math.isnan(depth_offset(TRUTH, TRUTH, 0 * MASK, 1.0, RULES))


GREY = Material((0.5, 0.5, 0.5), 0.5)


def rectangle(width: float, height: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[0, 0, height], [width, 0, height], [width, 1, height], [0, 1, height]], np.float64)
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def spread(count: int = 5000) -> np.ndarray:
    return sampled_surface(*rectangle(1.0), count, np.random.default_rng(1))


def test_a_surface_moved_off_is_that_far_off_both_ways_in_units_of_the_extent() -> None:
    found = surface_distance(*rectangle(1.0, 0.3), spread(), distance_from_mesh(*rectangle(1.0)), extent=2.0)
    assert found.accuracy == pytest.approx(0.15, rel=1e-6)
    assert found.completeness == pytest.approx(0.15, rel=1e-6)
    assert found.chamfer == pytest.approx(0.15, rel=1e-6)
    assert (found.samples, found.seed) == ((30_000, 5000), 0)


def test_half_a_surface_is_accurate_and_not_complete_and_twice_a_surface_the_reverse() -> None:
    half = surface_distance(*rectangle(0.5), spread(), distance_from_mesh(*rectangle(1.0)), extent=1.0)
    assert half.accuracy == pytest.approx(0.0, abs=1e-9)
    assert half.completeness == pytest.approx(0.125, rel=0.05), "the mean of x - 1/2 above 1/2, and of none below"
    assert half.chamfer == pytest.approx(half.completeness / 2)
    whole = surface_distance(*rectangle(2.0), spread(), distance_from_mesh(*rectangle(1.0)), extent=1.0)
    assert whole.accuracy == pytest.approx(0.25, rel=0.05)
    assert whole.completeness == pytest.approx(0.0, abs=1e-9)


def test_the_seed_decides_the_points() -> None:
    truth = distance_from_mesh(*rectangle(1.0))
    first, again, other = (surface_distance(*rectangle(2.0), spread(), truth, 1.0, seed).accuracy for seed in (0, 0, 1))
    assert first == again != other


def test_distances_from_cells_agree_with_the_solids() -> None:
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    ball = distance_from_cells(surfaces_of([Sphere((0.1, 0.2, 0.3), 1.0, GREY)], 0.02))
    for radius in (0.9, 1.0, 1.2):
        far = ball(np.array([0.1, 0.2, 0.3]) + radius * directions)
        assert far == pytest.approx(np.full(500, abs(radius - 1)), abs=2e-4)
    low, high = np.array([-0.5, -0.4, -0.3]), np.array([0.5, 0.6, 0.7])
    box = distance_from_cells(surfaces_of([Box((-0.5, -0.4, -0.3), (0.5, 0.6, 0.7), GREY)], 0.05))
    points = generator.uniform(-0.8, 1.0, (500, 3))
    beyond = np.maximum(low - points, points - high)
    expected = np.where(beyond.max(-1) > 0, np.linalg.norm(np.maximum(beyond, 0), axis=-1), -beyond.max(-1))
    assert box(points) == pytest.approx(expected, abs=2e-3)


def test_points_are_drawn_by_area() -> None:
    samples = surfaces_of([Box((0.0, 0.0, 0.0), (4.0, 1.0, 1.0), GREY), Sphere((0.0, 0.0, 5.0), 1.0, GREY)], 0.1)
    points = points_in_cells(samples, 40_000, seed=0)
    assert np.mean(points[:, 2] > 2) == pytest.approx(4 * np.pi / (4 * np.pi + 18), abs=0.01)
    assert distance_from_cells(samples)(points) == pytest.approx(np.zeros(len(points)), abs=1e-9)


@pytest.fixture(scope="module")
def corner() -> Scene:
    return load_scene("corner")


def test_a_generated_scene_is_compared_with_its_solids_as_far_as_test_views_see_them(corner: Scene) -> None:
    truth = true_shape(corner)
    everything = points_in_cells(corner.true_surfaces(corner.extent / 400), 30_000)
    bottom = min(solid.low[2] for solid in RECIPES["corner"].solids if isinstance(solid, Box))
    under = [np.mean(points[:, 2] < bottom + 1e-6) for points in (everything, truth.points)]
    assert under[0] > 0.1
    assert under[1] < 0.02, "of the underside of the floor nobody sees more than the rim, within the tolerance"
    assert 5000 < len(truth.points) < len(everything)
    assert truth.distance(truth.points).max() < 1e-9
    assert "solids" in truth.source


def test_without_solids_the_true_depth_of_test_views_is_taken_and_named(corner: Scene) -> None:
    solids, depths = true_shape(corner), true_shape(replace(corner, surfaces=None))
    assert "depth maps of 8 test views" in depths.source
    off = solids.distance(depths.points)
    pixel = corner.extent / corner.test[0].camera.fx
    assert np.median(off) < 0.05 * pixel, "the path tracer's depth maps show the solids"
    assert np.quantile(off, 0.9) < pixel
    assert distance_from_points(depths.points)(solids.points).mean() < pixel


def test_without_any_truth_there_is_a_reason(corner: Scene, tmp_path: Path) -> None:
    blind = replace(corner, surfaces=None, test=())
    with pytest.raises(DataError, match="not known") as raised:
        true_shape(blind)
    assert "no true depth" in raised.value.why
    with pytest.raises(DataError, match="not known") as raised:
        true_shape(replace(blind, layout="stanford-orb", folder=tmp_path / "blender_LDR" / "cup_scene003"))
    assert "mesh.obj is not there" in raised.value.why


def test_a_capture_of_stanford_orb_is_compared_with_its_scan(corner: Scene, tmp_path: Path) -> None:
    capture = tmp_path / "blender_LDR" / "cup_scene003"
    scan = tmp_path / "ground_truth" / "cup_scene003" / "mesh_blender" / "mesh.obj"
    scan.parent.mkdir(parents=True)
    vertices, faces = rectangle(1.0)
    pyvista.PolyData.from_regular_faces(vertices, faces).save(str(scan))
    truth = true_shape(replace(corner, layout="stanford-orb", folder=capture, surfaces=None))
    assert truth.vertices == pytest.approx(vertices)
    assert truth.distance(np.array([[0.5, 0.5, 0.2]])) == pytest.approx([0.2])
    assert len(truth.points) == 30_000
    scan.write_text("v 1 2 3\n")
    with pytest.raises(DataError, match="no triangles"):
        read_mesh(scan)
