"""The recipes of RadioGS: all settings as the paper prints them, as the published code has them, and as recommended.

A recipe is a set of values for fields of ``Variant``; the length of a run is that of its preset. ``printed`` has the
paper's values. Values that the paper does not state come from 2DGS, which the paper follows, else from the published
code; only the starting points are this project's, because random points of a cube need the paper's number of surfels
(``constants``). Two slips of the paper are mended: V is the transmittance, not 1 - T_trace, and the sparsity loss,
which is unbounded below, is the cross-entropy between coverage and the mask. ``released`` has the values of the
published scripts, which differ between scenes. ``recommended`` is the default of ``Variant``. ``constants`` lists every
value with its source, and values that no recipe reproduces.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from radiogs_core.errors import unknown

from .settings import DEVIATIONS

Values = Mapping[str, Any]
"""Plain values by dotted names of fields of ``Variant``."""


@dataclass(frozen=True)
class Recipe:
    """Named settings of RadioGS."""

    title: str
    """Description of the settings, in tables."""
    values: Values
    """The values that differ from the defaults of ``Variant``."""
    by_scene: Mapping[tuple[str, str], Values] = field(default_factory=dict)
    """Further values by layout and name of a scene; the name "" is for all scenes of the layout."""

    def of(self, layout: str, scene: str) -> dict[str, Any]:
        """All values for a scene, by its layout and name."""
        return {**self.values, **self.by_scene.get((layout, ""), {}), **self.by_scene.get((layout, scene), {})}


UNSAID: tuple[str, ...] = ("fixed-offset", "one-sided-rays", "start-light", "spread-views")
"""Deviations on whose subject the paper is silent, so that ``printed`` includes them."""

PRINTED: Values = {
    "deviations": UNSAID,
    "masking": "height-correlated",
    "relighting": "pbr",
    "met_light": "unoccluded",
    "geometry.backgrounds": (1.0,),
    "geometry.normal_target": "central",
    "geometry.edge_sharpness": 1.0,
    "geometry.across_silhouettes": True,
    "geometry.weights.normal_late": 0.05,
    "geometry.weights.distortion": 2.0,
    "geometry.weights.normal_smoothness": 0.02,
    "geometry.rates.end_share": 1.0,
    "geometry.density.end": 15_000 / 40_000,
    "geometry.density.hidden_at": (),
    "geometry.density.prune_unseen": False,
    "geometry.density.resets.lower_every": 3_000 / 40_000,
    "geometry.start.points": "hull",
    "geometry.start.roughness": 0.1,
    "split_sum.image": 1.0,
    "split_sum.geometry_gradient": True,
    "split_sum.light": 0.5,
    "materials.normal_from": 0.0,
    "materials.weights.squared": 0.0,
    "materials.weights.distortion": 2.0,
    "materials.weights.mask": 0.05,
    "materials.weights.normal_smoothness": 0.02,
    "materials.weights.albedo_smoothness": 0.2,
    "materials.weights.light_smoothness": 0.0,
    "materials.rates.radiance": 0.0025,
    "materials.rates.length_power": 0.83,
    "materials.rates.roughness_length_power": 0.83,
    "materials.directions.from_light": 0.0,
    "materials.directions.sets": 1,
    "materials.consistent_roughness": True,
    "materials.start.light": "constant",
    "finetuning.degree_0": 0.0025,
    "finetuning.unit": "one",
    "finetuning.last_share": 1.0,
}

RELEASED: Values = {
    **PRINTED,
    "deviations": tuple(DEVIATIONS),
    "geometry.weights.mask": 0.02,
    "geometry.start.points": "box",
    "geometry.schedule.normal_smoothness_until": 18_000 / 40_000,
    "geometry.rates.radiance": 0.0075,
    "geometry.rates.radiance_rest": 0.0075 / 20,
    "geometry.density.end": 25_000 / 40_000,
    "geometry.density.resets.raise_every": 1_000 / 40_000,
    "split_sum.consistency": 0.1,
    "split_sum.albedo_rate": 0.0075,
    "materials.normal_from": 1_000 / 20_000,
    "materials.weights.distortion": 0.0,
    "materials.weights.mask": 0.02,
    "materials.weights.normal_smoothness": 0.01,
    "materials.weights.light_smoothness": 0.02,
    "materials.rates.albedo": 0.0075,
    "materials.rates.constant_light": 0.005,
    "materials.rates.radiance": 0.0075,
    "materials.rates.radiance_rest": 0.0075 / 20,
    "finetuning.degree_0": 0.0075,
}

SHADED_ALONE: Values = {"geometry.weights.radiance": 0.0, "split_sum.consistency": 0.0}
"""Stage 1 without the image of the surfels' own radiance, as three of the published scripts have it."""

OF_SCRIPTS: Mapping[tuple[str, str], Values] = {
    ("tensoir", "hotdog"): {"ray_offset": 0.1, **SHADED_ALONE},
    ("tensoir", "lego"): {"materials.start.roughness": 0.8, "materials.weights.light_prior": 0.1},
    ("tensoir", "ficus"): {"materials.weights.light_smoothness": 0.002},
    ("synthetic4relight", ""): {
        "geometry.weights.mask": 0.05,
        "materials.weights.mask": 0.01,
        "materials.weights.albedo_smoothness": 1.0,
        "materials.weights.roughness_smoothness": 0.5,
        "materials.weights.light_prior": 0.1,
        "materials.rates.geometry": 0.001,
        "ray_offset": 0.1,
    },
    ("synthetic4relight", "air_baloons"): {"materials.rates.geometry": 0.0, **SHADED_ALONE},
    ("synthetic4relight", "chair"): {"ray_offset": 0.05},
    ("synthetic4relight", "hotdog"): SHADED_ALONE,
    ("synthetic4relight", "jugs"): {"materials.start.roughness": 0.8},
    ("stanford-orb", ""): {"geometry.weights.mask": 0.05, "materials.weights.mask": 0.01},
}
"""Where the published scripts of single scenes differ, by layout and scene."""

RECIPES: Mapping[str, Recipe] = {
    "printed": Recipe("as the paper prints it", PRINTED),
    "released": Recipe("as the published code has it", RELEASED, OF_SCRIPTS),
    "recommended": Recipe("as this project recommends it", {}),
}
"""The recipes by name."""

PUBLISHED = "printed"
"""The recipe that tables call by the published method's name."""


def recipe_values(name: str, layout: str, scene: str) -> dict[str, Any]:
    """The values of a recipe for a scene, by its layout and name. Raises UsageError for an unknown recipe."""
    if name not in RECIPES:
        raise unknown("recipe", name, RECIPES, of="radiogs")
    return RECIPES[name].of(layout, scene)
