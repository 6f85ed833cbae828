"""Recipes of RadioGS: the values of the paper and of the released code, and the labels of runs by them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from radiogs.constants import CONSTANTS, Constant, value_in
from radiogs.invert import rates_of
from radiogs.learning import MaterialRates
from radiogs.method import RADIOGS
from radiogs.recipes import OF_SCRIPTS, PRINTED, RECIPES, RELEASED, recipe_values
from radiogs.settings import DEVIATIONS, PRESETS, Variant
from radiogs.showing import labels_of
from radiogs_bench.suites.data_sets import STANFORD_ORB, SYNTHETIC4RELIGHT, TENSOIR
from radiogs_core.errors import UsageError
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, POSITIONS
from radiogs_core.plain_values import value_at, with_values
from radiogs_datasets.registry import LAYOUTS

LENGTH_POWER, ROUGHNESS_POWER = "materials.rates.length_power", "materials.rates.roughness_length_power"
"""The fields without a value in paper and code, whose runs have one length."""


HULL = "geometry.start.points"
"""The one field whose value in ``printed`` is neither the paper's, which states none, nor the code's."""


def listed() -> list[Constant]:
    """The constants that recipes reproduce, and for which the paper or its code has a value."""
    return [each for each in CONSTANTS if each.field and each.field not in (LENGTH_POWER, ROUGHNESS_POWER)]


@pytest.mark.parametrize("constant", listed(), ids=lambda each: each.field)
def test_printed_has_the_papers_value_or_else_the_codes_and_released_the_codes(constant: Constant) -> None:
    code = constant.paper if constant.code is None else constant.code
    assert code is not None
    printed = code if constant.paper is None else constant.paper
    assert value_in(constant, "printed") == ("hull" if constant.field == HULL else printed)
    if not constant.field.startswith("budget."):  # of presets, not of recipes
        assert value_in(constant, "released") == code


def test_every_value_of_a_recipe_is_a_listed_constant() -> None:
    fields = [each.field for each in CONSTANTS if each.field]
    assert len(set(fields)) == len(fields)
    for values in (PRINTED, RELEASED, *OF_SCRIPTS.values()):
        assert set(values) - {"deviations"} <= set(fields)
    assert {f"deviations.{name}" for name in DEVIATIONS} <= set(fields)


def test_constants_outside_all_recipes_have_a_reason() -> None:
    left_out = [each for each in CONSTANTS if not each.field]
    assert left_out
    assert all(each.remark and (each.paper or each.code) for each in left_out)


def test_the_recommended_recipe_is_the_default_and_the_others_differ_from_it_and_from_each_other() -> None:
    made = [with_values(Variant(), RECIPES[name].values) for name in ("recommended", "printed", "released")]
    assert made[0] == Variant()
    assert made[1] != made[0] != made[2] != made[1]


SPOTS: list[tuple[str, str, Mapping[str, Any]]] = [
    ("tensoir", "armadillo", {"ray_offset": 0.05, "materials.start.roughness": 0.6, "geometry.weights.radiance": 1.0}),
    ("tensoir", "hotdog", {"ray_offset": 0.1, "geometry.weights.radiance": 0.0, "split_sum.consistency": 0.0}),
    ("tensoir", "lego", {"materials.start.roughness": 0.8, "materials.weights.light_prior": 0.1}),
    ("tensoir", "ficus", {"materials.weights.light_smoothness": 0.002, "materials.weights.mask": 0.02}),
    ("synthetic4relight", "hotdog", {
        "ray_offset": 0.1, "materials.weights.albedo_smoothness": 1.0, "materials.weights.roughness_smoothness": 0.5,
        "materials.rates.geometry": 0.001, "geometry.weights.radiance": 0.0,
    }),
    ("synthetic4relight", "air_baloons", {"materials.rates.geometry": 0.0, "ray_offset": 0.1}),
    ("synthetic4relight", "jugs", {"materials.start.roughness": 0.8, "geometry.weights.radiance": 1.0}),
    ("synthetic4relight", "chair", {"ray_offset": 0.05, "materials.weights.light_prior": 0.1}),
    ("stanford-orb", "pepsi_scene002", {"geometry.weights.mask": 0.05, "materials.weights.mask": 0.01}),
    ("generated", "hotdog", {"ray_offset": 0.05, "materials.weights.mask": 0.02}),
]  # fmt: skip


@pytest.mark.parametrize(
    ("layout", "scene", "values"), SPOTS, ids=lambda value: value if isinstance(value, str) else ""
)
def test_released_has_the_values_of_the_scenes_script(layout: str, scene: str, values: Mapping[str, Any]) -> None:
    variant = with_values(Variant(), recipe_values("released", layout, scene))
    assert {name: value_at(variant, name) for name in values} == values


def test_the_scripts_are_of_scenes_that_there_are_and_make_variants() -> None:
    scenes = {"tensoir": TENSOIR.scenes, "synthetic4relight": SYNTHETIC4RELIGHT.scenes,
              "stanford-orb": STANFORD_ORB.scenes}  # fmt: skip
    for layout, scene in OF_SCRIPTS:
        assert layout in LAYOUTS
        assert scene in ("", *scenes[layout])
        with_values(Variant(), recipe_values("released", layout, scene))
        for name in ("printed", "recommended"):
            assert recipe_values(name, layout, scene) == RECIPES[name].values


def test_an_unknown_recipe_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UsageError, match="unknown recipe 'printd' of radiogs") as refused:
        recipe_values("printd", "tensoir", "lego")
    assert "'printed'" in f"{refused.value.why} {refused.value.remedy}"


def test_the_length_rule_changes_nothing_at_the_papers_length_and_longer_steps_are_bounded() -> None:
    assert POSITIONS.factor(40_000) == POSITIONS.factor(80_000) == 1.0
    assert 1.0 < POSITIONS.factor(20_000) < 2.0
    assert (GEOMETRY_PRESETS["paper"].rate, GEOMETRY_PRESETS["tiny"].rate) == (1.0, 12.0)
    root = MaterialRates(length_power=0.5)
    assert [root.factor(steps) for steps in (20_000, 5_000, 1)] == [1.0, 2.0, 12.0]
    assert MaterialRates().factor(600) == 1.0


def test_the_length_rule_scales_the_rates_of_materials_light_and_harmonics_in_stage_2_alone() -> None:
    variant = with_values(Variant(), {LENGTH_POWER: 0.5, ROUGHNESS_POWER: 0.0})
    for searched in (False, True):
        whole, quarter = (rates_of(variant, 1.0, steps, searched) for steps in (20_000, 5_000))
        longer = {name for name in whole if quarter[name] == 2 * whole[name] > 0}
        materials = {"albedo_logit", "sh", "sh_rest"}
        assert longer == materials | (set() if searched else {"log_environment"})
        assert all(quarter[name] == whole[name] for name in whole.keys() - longer)


def test_the_rate_of_roughness_has_a_power_of_its_own() -> None:
    variant = with_values(Variant(), {LENGTH_POWER: 0.0, ROUGHNESS_POWER: 0.5})
    whole, quarter = (rates_of(variant, 1.0, steps) for steps in (20_000, 5_000))
    assert {name for name in whole if quarter[name] != whole[name]} == {"roughness_logit"}
    assert quarter["roughness_logit"] == 2 * whole["roughness_logit"]


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


def test_a_label_states_length_and_rate_factors_unless_it_is_the_papers() -> None:
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
