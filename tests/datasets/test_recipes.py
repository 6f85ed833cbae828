"""Recipes stand up to what path tracing and the cameras ask of them; no Mitsuba needed."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from radiogs_core.errors import UsageError
from radiogs_datasets.generate import RECIPES, generate_scene, probe, trefoil
from radiogs_datasets.generate.cameras import pinhole
from radiogs_datasets.generate.environments import LIGHTS, WIDTH
from radiogs_datasets.generate.materials import Patterned
from radiogs_datasets.generate.patterns import Checker
from radiogs_datasets.generate.recipe import Recipe
from radiogs_datasets.generate.solids import Box, Knot, Solid
from reference.solids import knot_curve


def gap(first: Solid, second: Solid) -> float:
    """Distance between two solids; zero or less where they touch or overlap."""
    low, high, radius = zip(*(bounds(solid) for solid in (first, second)), strict=True)
    apart = np.maximum(np.maximum(low[0][:, None] - high[1], low[1] - high[0][:, None]), 0)
    return float(np.linalg.norm(apart, axis=-1).min()) - sum(radius)


def bounds(solid: Solid) -> tuple[np.ndarray, np.ndarray, float]:
    """A box of its own, a sphere as a point and a knot as points on its curve, with a radius around them."""
    if isinstance(solid, Box):
        return np.array([solid.low]), np.array([solid.high]), 0.0
    middle = knot_curve(solid, 4000) if isinstance(solid, Knot) else np.array([solid.centre])
    return middle, middle, solid.radius


@pytest.fixture(params=RECIPES.values(), ids=list(RECIPES))
def recipe(request: pytest.FixtureRequest) -> Recipe:
    return request.param


def test_solids_neither_touch_nor_overlap_and_stay_in_the_box(recipe: Recipe) -> None:
    for first, second in itertools.combinations(recipe.solids, 2):
        assert gap(first, second) > 1e-3
    for solid in recipe.solids:
        low, high, radius = bounds(solid)
        assert (low < high).all() or radius > 0
        assert max(np.abs(low).max(), np.abs(high).max()) + radius <= 1.3


def test_no_knot_meets_itself() -> None:
    """The points of its surface are as far from the nearest strand as from their own."""
    knots = [solid for recipe in RECIPES.values() for solid in recipe.solids if isinstance(solid, Knot)]
    assert knots
    for knot in knots:
        surface = trefoil.points(knot, *trefoil.grid(600, 120)).numpy()
        assert cKDTree(knot_curve(knot, 20_000)).query(surface)[0].min() > knot.radius - 1e-6


def test_no_face_lies_between_two_cubes_of_its_pattern(recipe: Recipe) -> None:
    """Rounding would decide which of the two is seen there."""
    for solid in recipe.solids:
        if isinstance(solid, Box) and isinstance(solid.material, Patterned):
            pattern = solid.material.pattern
            if isinstance(pattern, Checker):
                place = (np.array([solid.low, solid.high]) - pattern.origin) / pattern.side
                assert np.abs(place - place.round()).min() > 1e-3


def test_every_camera_looks_at_the_target_from_outside(recipe: Recipe) -> None:
    for place in range(56):
        matrix = pinhole(recipe.rig, place, 96).to_world
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
        assert matrix[2, 1] > 0  # the image's up is the world's
        np.testing.assert_allclose(matrix[:3, 3] - recipe.rig.radius * matrix[:3, 2], recipe.rig.target, atol=1e-12)


def test_cameras_of_the_corner_stand_before_both_walls() -> None:
    """Their inner faces, and the floor's, lie at x = -1 (red), y = -1.002 (green), z = -0.7 (white)."""
    for place in range(56):
        x, y, z = pinhole(RECIPES["corner"].rig, place, 96).to_world[:3, 3]
        assert (x > -1, y > -1.002, z > -0.7) == (True, True, True)


def test_suns_are_at_least_two_texels_wide() -> None:
    for light in LIGHTS.values():
        half_width = math.acos(1 - math.log(2) / light.sun.sharpness)
        assert 2 * half_width >= 2 * (2 * math.pi / WIDTH)


def test_lights_are_positive_and_of_different_character() -> None:
    warmth, contrast = {}, {}
    for name, light in LIGHTS.items():
        radiance = light.radiance()
        assert radiance.min() > 0
        warmth[name] = radiance[..., 0].mean() / radiance[..., 2].mean()
        contrast[name] = radiance.max() / radiance.mean()
    assert warmth["sunset"] > 1.3 > warmth["sky"] > warmth["overcast"]
    assert contrast["overcast"] < 6 < contrast["sky"]


def test_an_unknown_recipe_is_an_error(tmp_path) -> None:
    with pytest.raises(UsageError, match="corner, convex"):
        generate_scene("no_such_scene", tmp_path / "a")


@pytest.mark.parametrize("script", ["import no_such_module", "import os; os.abort()"])
def test_a_mitsuba_that_fails_or_aborts_is_an_error_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path, script: str
) -> None:
    monkeypatch.setattr(probe, "_SCRIPT", script)
    with pytest.raises(UsageError, match="libllvm19") as caught:
        generate_scene("corner", tmp_path / "a")
    assert "trial render failed" in caught.value.why
    assert not (tmp_path / "a").exists()
