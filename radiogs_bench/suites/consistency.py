"""Suites on the value of radiometric consistency, L_rad, and on what that value depends."""

from collections.abc import Mapping
from typing import Any

from radiogs_core.capabilities import Part

from .own import EVERY_PART
from .paper import ABLATIONS
from .suite import JUDGED, Row, Suite, metrics

PRINTED, RECOMMENDED = "printed", "recommended"

Values = Mapping[str, Any]

DEPARTURE_GROUPS: Mapping[str, tuple[str, Values]] = {
    "start": ("surfels start at swept depth", {"geometry.start.points": "swept", "geometry.start.roughness": 0.6}),
    "density": (
        "hidden surfels removed, no resets",
        {
            "geometry.density.end": 0.625,
            "geometry.density.hidden_at": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0],
            "geometry.density.prune_unseen": True,
            "geometry.density.resets.lower_every": 0.0,
        },
    ),
    "shape": (
        "losses and rates of shape",
        {
            "geometry.backgrounds": [1.0, 0.0],
            "geometry.normal_target": "one-sided",
            "geometry.edge_sharpness": 10.0,
            "geometry.across_silhouettes": False,
            "geometry.weights.normal_late": 0.1,
            "geometry.weights.distortion": 0.1,
            "geometry.weights.normal_smoothness": 0.05,
            "geometry.rates.end_share": 0.05,
        },
    ),
    "split-sum": (
        "split sum shapes no surfels",
        {"split_sum.image": 0.1, "split_sum.geometry_gradient": False, "split_sum.light": 1.0},
    ),
    "rays": ("ray starts, two-sided rays, masking", {"deviations": [], "masking": "schlick"}),
    "light": (
        "light sought, then held",
        {"materials.start.light": "least-variation", "materials.weights.light_smoothness": 0.005},
    ),
    "losses": (
        "losses and rates of stage 2",
        {
            "materials.normal_from": 0.05,
            "materials.weights.distortion": 0.0,
            "materials.weights.mask": 0.02,
            "materials.weights.normal_smoothness": 0.01,
            "materials.weights.albedo_smoothness": 1.0,
            "materials.rates.radiance": 0.005,
            "materials.rates.length_power": 0.0,
        },
    ),
    "directions": (
        "two sets, half drawn from the light",
        {"materials.directions.from_light": 0.5, "materials.directions.sets": 2},
    ),
    "roughness": (
        "roughness without L_rad, squared error",
        {
            "materials.consistent_roughness": False,
            "materials.rates.roughness_length_power": 0.5,
            "materials.weights.squared": 10.0,
        },
    ),
    "relighting": (
        "relighting by traced bounces",
        {
            "relighting": "bounces",
            "met_light": "occluded",
            "finetuning.degree_0": 0.3,
            "finetuning.unit": "mean radiance",
            "finetuning.last_share": 0.02,
        },
    ),
}
"""The groups of settings in which ``recommended`` departs from ``printed``, in the order of training: a label and the
recommended values by dotted names."""


def _departures() -> tuple[Row, ...]:
    rows, values = [Row(PRINTED, "As printed", "as printed", recipe=PRINTED)], dict[str, Any]()
    for key, (text, group) in DEPARTURE_GROUPS.items():
        values |= group
        rows.append(Row(key, "", text, dict(values), recipe=PRINTED))
    return tuple(rows)


DEPARTURES = Suite(
    name="departures",
    title="From RadioGS as printed to RadioGS as recommended",
    published=None,
    reference=PRINTED,
    rows=_departures(),
    columns=EVERY_PART,
    scenes=JUDGED,
)
"""Every row has the changes of all rows above it; the last one is the recipe ``recommended``."""

CONSISTENT: Mapping[str, Values] = {"": {}, "no-rad": {"radiometric_weight": 0.0}}
"""A row with L_rad, and one without it."""


def _both(key: str, text: str, values: Values, recipe: str = "", *given: Part) -> tuple[Row, ...]:
    """A row with the parts ``given``, and the same row without L_rad."""
    return tuple(
        Row(f"{key}-{without}".rstrip("-"), "", f"{text}, λ_rad = 0" if without else text, {**values, **change},
            recipe=recipe, given=given or None)
        for without, change in CONSISTENT.items()
    )  # fmt: skip


LEARNT: Values = {"materials.rates.light": 0.01}
"""Settings by which a sought light is learnt further in stage 2 at the paper's rate."""

SOUGHT: Values = {
    "materials.start.light": "least-variation",
    "deviations": ["fixed-offset", "one-sided-rays", "spread-views"],
}
"""As printed, but the light is sought: the deviation ``start-light`` would replace the start by a constant light."""

RIVALS = Suite(
    name="rivals",
    title="Radiometric consistency beside the parts that may do the same",
    published=None,
    reference=RECOMMENDED,
    rows=(
        *_both(RECOMMENDED, "recommended", {}, RECOMMENDED),
        *_both("learnt", "recommended, light learnt on", LEARNT, RECOMMENDED),
        *_both("constant", "recommended, from a constant light", {"materials.start.light": "constant"}, RECOMMENDED),
        *_both(
            "one-set", "recommended, one set of directions over the hemisphere",
            {"materials.directions.from_light": 0.0, "materials.directions.sets": 1}, RECOMMENDED,
        ),
        Row(
            "rad-roughness", "", "recommended, L_rad has gradient to roughness",
            {"materials.consistent_roughness": True}, recipe=RECOMMENDED,
        ),
        *_both(PRINTED, "printed", {}, PRINTED),
        *_both("printed-held", "printed, light sought and held", SOUGHT, PRINTED),
        *_both("printed-learnt", "printed, light sought and learnt on", {**SOUGHT, **LEARNT}, PRINTED),
        *_both("printed-directions", "printed, two sets of directions", DEPARTURE_GROUPS["directions"][1], PRINTED),
        Row(
            "printed-roughness", "", "printed, L_rad has no gradient to roughness",
            {"materials.consistent_roughness": False}, recipe=PRINTED,
        ),
    ),
    columns=EVERY_PART,
    scenes=JUDGED,
)  # fmt: skip
"""The paths to a right light, a right estimator and a right roughness, each with and without L_rad, from both
recipes."""

LENGTHS: Mapping[str, float] = {"half": 0.5, "1": 1.0, "2-5": 2.5, "5": 5.0, "10": 10.0}
"""Factors of the preset's steps of stage 2."""

CONSISTENCY_LENGTH = Suite(
    name="consistency-length",
    title="Radiometric consistency by the length of stage 2",
    published=None,
    reference="recommended-1",
    rows=tuple(
        Row(
            f"{recipe}{without and f'-{without}'}-{name}", "",
            f"{recipe}{', λ_rad = 0' if without else ''}, <inverse_iterations> steps", change,
            {"inverse_iterations": factor}, recipe=recipe,
        )
        for recipe in (RECOMMENDED, PRINTED)
        for without, change in CONSISTENT.items()
        for name, factor in LENGTHS.items()
    ),
    columns=EVERY_PART,
    scenes=JUDGED,
)  # fmt: skip
"""Four curves for each scene: both recipes, with and without L_rad."""

CLOSED = Suite(
    name="closed",
    title="Radiometric consistency at the paper's rates",
    published="ablation",
    reference="ours",
    rows=(
        *ABLATIONS.rows[:2],
        *_both("held", "light sought and held", SOUGHT),
        *_both("true", "true light, held", {}, "", "light"),
        *_both("constant", "constant light, held", {"materials.rates.constant_light": 0.0}),
    ),
    columns=(*EVERY_PART, *metrics("environment/error", "scale/factor")),
    scenes=(*JUDGED, "crowd", "grotto", "trophy", "nefertiti"),
    recipe=PRINTED,
)
"""With and without L_rad, under four lights, on scenes of eight kinds on which no setting was chosen; five are by other
hands. The length rule's factor is 1 at the paper's length (``--set inverse_iterations=20000``), and
at every length with ``--set materials.rates.length_power=0``, which separates the effects of length and rates."""
