"""Recipes stand up to what path tracing and the cameras ask of them; no Mitsuba needed."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import label
from scipy.spatial import cKDTree

from radiogs_core.errors import UsageError
from radiogs_datasets.generate import RECIPES, generate_scene, probe, rounds, trefoil
from radiogs_datasets.generate.cameras import pinhole
from radiogs_datasets.generate.environments import HEIGHT, LIGHTS, WIDTH
from radiogs_datasets.generate.materials import Patterned
from radiogs_datasets.generate.patterns import Checker
from radiogs_datasets.generate.recipe import Recipe
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


def test_cameras_of_the_corner_stand_before_both_walls() -> None:
    """Their inner faces, and the floor's, lie at x = -1 (red), y = -1.002 (green), z = -0.7 (white)."""
    for place in range(56):
        x, y, z = pinhole(RECIPES["corner"].rig, place, 96).to_world[:3, 3]
        assert (x > -1, y > -1.002, z > -0.7) == (True, True, True)


@pytest.mark.parametrize(("name", "front"), [("front_plain", (0.0, 1.0, 0.0)), ("front_patterned", (1.0, 0.0, 0.0))])
def test_cameras_of_the_interiors_are_within_forty_degrees_of_the_front(
    name: str, front: tuple[float, float, float]
) -> None:
    """Their openings face this way: no solid begins beyond the walls' ends."""
    recipe = RECIPES[name]
    backward = np.stack([pinhole(recipe.rig, place, 96).to_world[:3, 2] for place in range(recipe.train + 8)])
    angle = np.degrees(np.arccos(backward @ front))
    assert 25 < angle.max() < 40
    walls = [solid for solid in recipe.solids[:4] if isinstance(solid, Box)]
    ends = [np.dot(solid.high, front) for solid in walls]
    assert len(walls) == 4
    assert sorted(ends)[0] < 0 < sorted(ends)[1] == sorted(ends)[3]


def test_lobes_of_lights_are_at_least_three_texels_wide() -> None:
    for light in LIGHTS.values():
        for lobe in light.lobes:
            half_width = math.acos(1 - math.log(2) / lobe.sharpness)
            assert 2 * half_width >= 3 * (2 * math.pi / WIDTH)


def spread(name: str) -> tuple[float, float]:
    """The largest value and the deviation, over the mean, of a light's luminance above the horizon, by solid angle."""
    radiance = LIGHTS[name].radiance()[: HEIGHT // 2].astype(np.float64).mean(-1)
    weight = np.sin((np.arange(HEIGHT // 2) + 0.5) * np.pi / HEIGHT)[:, None] * np.ones_like(radiance)
    mean = np.average(radiance, weights=weight)
    return radiance.max() / mean, np.sqrt(np.average((radiance - mean) ** 2, weights=weight)) / mean


def test_the_sky_of_the_sculpture_has_structure_and_no_sun() -> None:
    name = RECIPES["sculpture"].training_light
    peak, deviation = spread(name)
    assert peak < 2.5
    assert deviation > 0.2
    above = LIGHTS[name].radiance()[HEIGHT // 4].mean(-1)  # along one height: a gradient has no structure there
    rises = np.sign(np.diff(above, append=above[:1]))
    assert (rises != np.roll(rises, 1)).sum() >= 6


def test_the_sky_of_the_glossware_has_a_sun_and_structure_besides() -> None:
    light = LIGHTS[RECIPES["glossware"].training_light]
    suns = [lobe for lobe in light.lobes if lobe.sharpness >= 50]
    assert len(suns) == 1
    assert spread(RECIPES["glossware"].training_light)[0] > 10
    rest = replace(light, lobes=tuple(lobe for lobe in light.lobes if lobe not in suns)).radiance()[: HEIGHT // 2]
    assert rest.mean(-1).max() > 2.5 * rest.mean()


def test_the_lamps_are_several_small_and_coloured_and_the_night_is_dark() -> None:
    radiance = LIGHTS[RECIPES["lamps"].training_light].radiance()
    spots, count = label(radiance.max(-1) > 0.5)
    assert count == 5
    found = np.stack([radiance[spots == number + 1].max(0) for number in range(count)])
    hues = found / found.max(-1, keepdims=True)
    assert min(np.abs(one - other).max() for one, other in itertools.combinations(hues, 2)) > 0.2
    assert np.median(radiance) < 0.01 * found.max(-1).min()


def test_kinds_and_what_may_be_chosen_on() -> None:
    kinds = {name: recipe.kind for name, recipe in RECIPES.items() if recipe.kind != "single effects"}
    assert list(kinds) == ["front_plain", "front_patterned", "sculpture", "glossware", "crowd", "lamps"]
    assert len(set(kinds.values())) == 6
    reported = {name for name, recipe in RECIPES.items() if recipe.choices == "reported only"}
    assert reported == {"front_patterned", "crowd", "lamps"}
    assert {name: recipe.train for name, recipe in RECIPES.items() if recipe.train != 48} == {
        "front_patterned": 24, "sculpture": 64,
    }  # fmt: skip


def test_vessels_of_the_glossware_are_smooth_and_textured() -> None:
    vessels = [solid for solid in RECIPES["glossware"].solids if isinstance(solid, Turned)]
    assert len(vessels) >= 4
    for solid in RECIPES["glossware"].solids:
        assert isinstance(solid.material, Patterned)
        for part in (solid.material.first, solid.material.second):
            assert 0.08 <= part.roughness <= 0.3
    ends = {part.roughness for solid in vessels for part in (solid.material.first, solid.material.second)}  # type: ignore[union-attr]
    assert (min(ends), max(ends)) == (0.08, 0.3)


def test_the_lamps_shine_on_concave_parts() -> None:
    """From a hollow some of the object's own surface is in front of the tangent plane."""
    for solid in (solid for solid in RECIPES["lamps"].solids if isinstance(solid, Turned | Relief)):
        samples = surfaces_of([solid], 0.06)
        ahead = (samples.centre[None] - samples.centre[:, None]) @ samples.frame[..., 2, None]
        assert float((ahead[..., 0] > 0.02).any(1).double().mean()) > 0.2


def test_lights_are_positive_and_of_different_character() -> None:
    warmth, contrast = {}, {}
    for name, light in LIGHTS.items():
        radiance = light.radiance()
        assert radiance.min() > 0
        warmth[name] = radiance[..., 0].mean() / radiance[..., 2].mean()
        contrast[name] = radiance.max() / radiance.mean()
    assert warmth["sunset"] > 1.3 > warmth["sky"] > warmth["overcast"]
    assert max(contrast["overcast"], contrast["veil"]) < 6 < min(contrast["sky"], contrast["broken"])


def test_an_unknown_recipe_is_an_error(tmp_path) -> None:
    with pytest.raises(UsageError, match="corner, convex"):
        generate_scene("no_such_scene", tmp_path / "a")


@pytest.mark.parametrize("script", ["import no_such_module", "import os; os.abort()"])
def test_a_mitsuba_that_fails_or_aborts_is_an_error_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path, script: str
) -> None:
    monkeypatch.setattr(probe, "SCRIPT", script)
    with pytest.raises(UsageError, match="libllvm19") as caught:
        generate_scene("corner", tmp_path / "a")
    assert "trial render failed" in caught.value.why
    assert not (tmp_path / "a").exists()
