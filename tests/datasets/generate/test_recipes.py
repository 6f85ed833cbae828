"""Recipes meet the requirements of path tracing and cameras; no Mitsuba needed."""

import itertools
import math

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from radiogs_core.errors import UsageError
from radiogs_datasets.generate import RECIPES, generate_scene, probe, rounds, trefoil
from radiogs_datasets.generate.environments import LIGHTS, WIDTH
from radiogs_datasets.generate.materials import Patterned
from radiogs_datasets.generate.patterns import Checker
from radiogs_datasets.generate.recipe import Recipe, pinhole
from radiogs_datasets.generate.solids import Box, Knot, Relief, Solid, Turned
from radiogs_datasets.generate.surfaces import surfaces_of
from reference.solids import knot_curve

SPACING = 0.02
"""Distance between the points that sample a surface, world units."""


def gap(first: Solid, second: Solid) -> float:
    """Distance between two solids, where one is round to within half a spacing; zero or less where they overlap."""
    low, high, radius = zip(*(bounds(solid) for solid in (first, second)), strict=True)
    if isinstance(first, Box) or isinstance(second, Box):
        low, high = zip(*sorted(zip(low, high, strict=True), key=lambda pair: len(pair[0])), strict=True)
        apart = np.maximum(np.maximum(low[0] - high[1], low[1] - high[0]), 0)
        return float(np.linalg.norm(apart, axis=-1).min()) - sum(radius)
    return float(cKDTree(low[0]).query(low[1])[0].min()) - sum(radius)


def bounds(solid: Solid) -> tuple[np.ndarray, np.ndarray, float]:
    """A box of its own, others as points with a radius around them: a sphere's middle, a knot's curve, a surface."""
    if isinstance(solid, Box):
        return np.array([solid.low]), np.array([solid.high]), 0.0
    if isinstance(solid, Turned | Relief):
        points = surfaces_of([solid], SPACING).centre.numpy()
        return points, points, 0.0
    middle = knot_curve(solid, 4000) if isinstance(solid, Knot) else np.array([solid.centre])
    return middle, middle, solid.radius


@pytest.fixture(params=RECIPES.values(), ids=list(RECIPES))
def recipe(request: pytest.FixtureRequest) -> Recipe:
    return request.param


@pytest.mark.slow
def test_solids_neither_touch_nor_overlap_and_stay_in_the_box(recipe: Recipe) -> None:
    for first, second in itertools.combinations(recipe.solids, 2):
        assert gap(first, second) > 1e-3
        for one, other in ((first, second), (second, first)):
            if isinstance(one, Turned | Relief):  # whose surface alone says nothing of what lies within
                at = np.concatenate(bounds(other)[:2])
                assert not rounds.inside(one, torch.from_numpy(at).double(), 0.0).any()
    for solid in recipe.solids:
        low, high, radius = bounds(solid)
        assert (low < high).all() or not isinstance(solid, Box)
        assert max(np.abs(low).max(), np.abs(high).max()) + radius <= 1.3


def test_no_knot_meets_itself() -> None:
    """The points of its surface are as far from the nearest strand as from their own."""
    knots = [solid for recipe in RECIPES.values() for solid in recipe.solids if isinstance(solid, Knot)]
    assert knots
    for knot in knots:
        surface = trefoil.points(knot, *trefoil.grid(400, 80)).numpy()
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
    for place in range(recipe.train + 8):
        matrix = pinhole(recipe.rig, place, 96).to_world
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
        assert matrix[2, 1] > 0  # the image's up is the world's
        np.testing.assert_allclose(matrix[:3, 3] - recipe.rig.radius * matrix[:3, 2], recipe.rig.target, atol=1e-12)


def test_lights_are_positive_and_their_lobes_at_least_three_texels_wide() -> None:
    for light in LIGHTS.values():
        assert light.radiance().min() > 0
        for lobe in light.lobes:
            half_width = math.acos(1 - math.log(2) / lobe.sharpness)
            assert 2 * half_width >= 3 * (2 * math.pi / WIDTH)


def test_kinds_and_choices_of_the_scenes() -> None:
    kinds = {name: recipe.kind for name, recipe in RECIPES.items() if recipe.kind != "single effects"}
    assert list(kinds) == ["front_plain", "front_patterned", "sculpture", "glossware", "crowd", "lamps"]
    assert len(set(kinds.values())) == 6
    reported = {name for name, recipe in RECIPES.items() if recipe.choices == "reported only"}
    assert reported == {"front_patterned", "crowd", "lamps"}
    assert {name: recipe.train for name, recipe in RECIPES.items() if recipe.train != 48} == {
        "front_patterned": 24, "sculpture": 64,
    }  # fmt: skip


def test_an_unknown_recipe_is_an_error(tmp_path) -> None:
    with pytest.raises(UsageError, match="corner, convex"):
        generate_scene("no_such_scene", tmp_path / "a")


@pytest.mark.parametrize("script", ["import no_such_module", "import os; os.abort()"])
def test_a_mitsuba_that_fails_or_aborts_is_an_error_naming_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path, script: str
) -> None:
    monkeypatch.setattr(probe, "SCRIPT", script)
    with pytest.raises(UsageError, match="libllvm19") as caught:
        generate_scene("corner", tmp_path / "a")
    assert "trial render failed" in caught.value.why
    assert not (tmp_path / "a").exists()
