"""The labels of a trained model say its recipe, its length, and every setting that is not as printed, by comparing."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from radiogs.method import RADIOGS
from radiogs.recipes import PRINTED, recipe_values
from radiogs.settings import PRESETS, Variant
from radiogs.showing import labels_of
from radiogs_core.plain_values import value_at, with_values

WHOLE = PRESETS["paper"]


def labels(recipe: str, layout: str = "generated", scene: str = "corner", **changed: Any) -> Mapping[str, str]:
    """Labels of a variant by a recipe with some fields changed, at the paper's length."""
    variant = with_values(Variant(), {**recipe_values(recipe, layout, scene), **changed})
    return labels_of(variant, WHOLE, layout, scene)


def test_a_run_as_printed_at_the_papers_length_has_its_recipe_as_the_only_label() -> None:
    assert labels("printed") == {"recipe": "printed, as the paper prints it"}


def test_a_recommended_run_names_every_field_that_is_not_as_printed_with_both_values() -> None:
    found = labels("recommended")
    assert found["recipe"] == "recommended, as this project recommends it"
    assert list(found)[1:] == ["stage 1, not as printed", "stage 2, not as printed", "light and rays, not as printed"]
    assert "split_sum.image" not in found["recipe"]
    assert "weights.distortion 0.1 (printed: 2)" in found["stage 1, not as printed"]
    assert "weights.albedo_smoothness 1 (printed: 0.2)" in found["stage 2, not as printed"]
    assert "masking schlick (printed: height-correlated)" in found["light and rays, not as printed"]
    printed = with_values(Variant(), PRINTED)
    differs = [name for name in PRINTED if value_at(printed, name) != value_at(Variant(), name)]
    said = sum(value.count("(printed: ") for value in found.values())
    assert said == len(differs) == len(PRINTED)


def test_a_changed_field_is_named_beside_the_recipe_and_nowhere_else() -> None:
    changed = {"materials.weights.mask": 0.5, "radiometric_weight": 0.0}
    found = labels("printed", **changed)
    assert found == {
        "recipe": "printed, as the paper prints it, but for radiometric_weight = 0, materials.weights.mask = 0.5"
    }
    assert labels("recommended", **changed)["recipe"].startswith("recommended, ")


@pytest.mark.parametrize(("layout", "scene"), [("tensoir", "lego"), ("synthetic4relight", "jugs")])
def test_a_released_run_is_known_by_the_values_of_its_scenes_script(layout: str, scene: str) -> None:
    found = labels("released", layout, scene)
    assert found["recipe"] == "released, as the published code has it"
    assert "start.roughness 0.8 (printed: 0.6)" in found["stage 2, not as printed"]
    assert (
        "but for"
        in labels_of(with_values(Variant(), recipe_values("released", layout, scene)), WHOLE, "", "")["recipe"]
    )


def test_the_length_is_said_with_the_factors_of_rates_unless_it_is_the_papers() -> None:
    printed = with_values(Variant(), PRINTED)
    small = labels_of(printed, PRESETS["small"], "generated", "corner")["length"]
    assert small.startswith("5,000 + 3,000 steps (paper: 40,000 + 20,000)")
    # (40,000 / 5,000) ^ 0.83, its root, and (20,000 / 3,000) ^ 0.83
    assert "positions times 5.62" in small
    assert "rotations times 2.37" in small
    assert "harmonics times 4.83" in small
    assert "N_g 1,024 (paper: 4,096), N_s 64 (paper: 64)" in small
    tiny = labels_of(Variant(), PRESETS["tiny"], "generated", "corner")["length"]
    assert "positions times 12 and of rotations times 3.46" in tiny
    assert "harmonics times 1 in stage 2" in tiny


def test_published_recipes_are_called_shortened_with_their_factor_in_fewer_steps_than_published() -> None:
    printed, flat = (
        with_values(Variant(), {**PRINTED, **change}) for change in ({}, {"materials.rates.length_power": 0.0})
    )
    tiny, small = PRESETS["tiny"], PRESETS["small"]
    assert RADIOGS.recipe_at("printed", printed, tiny) == "printed, shortened (600 steps, rates x 12)"
    assert RADIOGS.recipe_at("released", printed, small) == "released, shortened (3,000 steps, rates x 4.83)"
    assert RADIOGS.recipe_at("printed", flat, tiny) == "printed, shortened (600 steps, rates x 1)"
    assert RADIOGS.recipe_at("printed", printed, replace(tiny, inverse_iterations=20_000)) == "printed, closed at tiny"
    assert RADIOGS.recipe_at("printed", printed, WHOLE) == "printed"
    assert RADIOGS.recipe_at("recommended", Variant(), tiny) == "recommended"
