"""Labels of a trained model: its recipe, its length beside the paper's, and all settings that differ from the paper."""

from collections.abc import Mapping

from radiogs_core.learning.geometry import turning
from radiogs_core.plain_values import leaf_names, value_at, with_values

from .constants import as_text
from .recipes import PUBLISHED, RECIPES
from .settings import PRESETS, Budget, Variant

TOPICS: Mapping[str, tuple[str, ...]] = {
    "stage 1": ("geometry", "split_sum"),
    "stage 2": ("materials", "deviations"),
    "light and rays": ("masking", "ray_offset", "relighting", "met_light", "finetuning"),
}
"""Labels of settings by the first part of their names."""

WHOLE = PRESETS["paper"]


def labels_of(variant: Variant, budget: Budget, layout: str, scene: str) -> dict[str, str]:
    """Differences of a run from the paper, by name. ``layout`` and ``scene``: of the scene, for its recipe's values."""
    name, recipe = nearest_recipe(variant, layout, scene)
    own = differences(variant, recipe)
    printed = with_values(Variant(), RECIPES[PUBLISHED].of(layout, scene))
    labels = {"recipe": f"{name}, {RECIPES[name].title}{but_for(own)}"}
    labels |= length_label(variant, budget)
    apart = differences(recipe, printed)
    for topic, firsts in TOPICS.items():
        found = [
            f"{each.partition('.')[2] or each} {value} (printed: {theirs})"
            for each, (value, theirs) in apart.items() if each.partition(".")[0] in firsts
        ]  # fmt: skip
        if found:
            labels[f"{topic}, not as printed"] = ", ".join(found)
    return labels


def nearest_recipe(variant: Variant, layout: str, scene: str) -> tuple[str, Variant]:
    """The recipe from which a variant differs in the fewest fields, and the recipe's variant for the scene."""
    made = {name: with_values(Variant(), recipe.of(layout, scene)) for name, recipe in RECIPES.items()}
    name = min(made, key=lambda each: len(differences(variant, made[each])))
    return name, made[name]


def differences(variant: Variant, other: Variant) -> dict[str, tuple[str, str]]:
    """The fields in which two variants differ, with both values as text."""
    return {
        name: (as_text(value_at(variant, name)), as_text(value_at(other, name)))
        for name in leaf_names(variant)
        if value_at(variant, name) != value_at(other, name)
    }


def but_for(own: Mapping[str, tuple[str, str]]) -> str:
    """The fields in which a run differs from its recipe, in words; empty without any."""
    return f", but for {', '.join(f'{name} = {value}' for name, (value, _) in own.items())}" if own else ""


def length_label(variant: Variant, budget: Budget) -> dict[str, str]:
    """The label ``length``: the steps beside the paper's, and the factors of rates that follow; empty at its length."""
    stages = (budget.geometry.steps, budget.inverse_iterations)
    whole = (WHOLE.geometry.steps, WHOLE.inverse_iterations)
    if stages == whole:
        return {}
    factor = variant.materials.rates.factor(budget.inverse_iterations)
    return {
        "length": f"{stages[0]:,} + {stages[1]:,} steps (paper: {whole[0]:,} + {whole[1]:,}); schedules are shares of"
        f" a stage; the length rule takes rates of positions times {budget.geometry.rate:.3g} and of rotations times"
        f" {turning(budget.geometry.rate):.3g} in stage 1, of materials, light and harmonics times {factor:.3g} in"
        f" stage 2; N_g {budget.consistency_surfels:,} (paper: {WHOLE.consistency_surfels:,}), N_s"
        f" {budget.incident_samples} (paper: {WHOLE.incident_samples})"
    }
