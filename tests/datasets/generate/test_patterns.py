"""Patterns are what their descriptions say, and the same in every arithmetic; no Mitsuba needed."""

import math

import numpy as np
import pytest
import torch

from radiogs_datasets.generate import RECIPES
from radiogs_datasets.generate.materials import Material, Patterned
from radiogs_datasets.generate.patterns import GLYPHS, Checker, Noise, Pattern, Print, Rings, Stripes, segments

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
