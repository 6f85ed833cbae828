"""A long run in short, for a rehearsal (``radiogs_core.capabilities.Rehearsing``)."""

from dataclasses import replace

from radiogs_core.capabilities import Relighting, ShortRun, StepKind
from radiogs_core.plain_values import with_values

from .settings import RELIGHTING, Budget, Variant

INITIALISE_STEPS = 12
"""Steps of the short stage 1. Schedules depend on the share of steps done, so that all harmonics and losses occur."""

DENSIFY_EVERY = 3
"""Steps between two rounds of density control in the short stage 1."""

PRUNED_AFTER = 11
"""Steps of the short stage 1 before the search for hidden surfels; no round of density control is due then."""

INVERT_STEPS = 6
"""Steps of the short stage 2."""

REFRESH_EVERY = 4
"""Steps of the short stage 2 between two tracings of all light."""

FINETUNE_STEPS = 3
"""Steps of the short fine-tuning: the first, which is not counted, and two that are."""

TITLES = {
    "pbr": "by rays, split sum",
    "finetuned": "by rays, fine-tuned",
    "surfels": "by surfels alone, fine-tuned",
}
"""Titles of modes of relighting by which stored measurements are compared; other modes have the method's title."""


def sizes(budget: Budget) -> tuple[int, int]:
    """Initial and largest number of surfels of a run."""
    geometry = budget.geometry
    return min(geometry.initial_surfels, geometry.maximum_surfels), geometry.maximum_surfels


def short_run(variant: Variant, budget: Budget, size: int) -> ShortRun:
    """A run of a few steps that begins with ``size`` surfels and never has more.

    The surfels start in the visual hull, whichever start the variant names; the surfels of a trained model lie on
    surfaces instead. The search for hidden surfels runs once but removes none: most surfels in a hull are hidden, and
    the model has to keep its size.
    """
    short = replace(
        budget,
        geometry=replace(
            budget.geometry,
            steps=INITIALISE_STEPS,
            initial_surfels=size,
            maximum_surfels=size,
            densify_interval=DENSIFY_EVERY,
        ),
        inverse_iterations=INVERT_STEPS,
        refresh_interval=REFRESH_EVERY,
        finetune_iterations=min(FINETUNE_STEPS, budget.finetune_iterations),
    )
    kinds = {
        "initialise": _kinds(_density_kinds(variant, budget), budget.geometry.steps, INITIALISE_STEPS),
        "invert": _kinds((), budget.inverse_iterations, INVERT_STEPS),
    }
    if variant.shading == "monte-carlo" and variant.incident != "precomputed":
        refreshed, whole = frozenset({REFRESH_EVERY}), (budget.inverse_iterations - 1) // budget.refresh_interval
        tracing = StepKind("step that traces all light anew", refreshed, whole)
        kinds["invert"] = _kinds((tracing,), budget.inverse_iterations, INVERT_STEPS)
    rehearsed = _shortened(variant)
    ways = tuple(
        Relighting(
            TITLES.get(mode, f"by {title}"),
            with_values(rehearsed, {RELIGHTING.field: mode}),
            budget.finetune_iterations if mode in RELIGHTING.by_steps else 0,
        )
        for mode, title in RELIGHTING.titles.items()
        if mode != RELIGHTING.reference
    )
    return ShortRun(rehearsed, short, kinds, ways)


def _shortened(variant: Variant) -> Variant:
    """The variant that starts in the visual hull, searches for hidden surfels once, if at all, and removes none."""
    learning = variant.geometry
    hidden_at = (PRUNED_AFTER / INITIALISE_STEPS,) if learning.density.hidden_at else ()
    density = replace(learning.density, hidden_at=hidden_at, least_contribution=0.0)
    return replace(variant, geometry=replace(learning, start=replace(learning.start, points="hull"), density=density))


def _density_kinds(variant: Variant, budget: Budget) -> tuple[StepKind, ...]:
    """Steps of stage 1 with a round of density control, and with the search for hidden surfels in all views.

    A step with both counts as one of each, because their extra times add.
    """
    rules = variant.geometry.density
    rounds = frozenset(
        done - 1
        for done in range(DENSIFY_EVERY, INITIALISE_STEPS, DENSIFY_EVERY)
        if rules.start <= done / INITIALISE_STEPS < rules.end
    )
    whole_rounds = int((rules.end - rules.start) * budget.geometry.steps / budget.geometry.densify_interval)
    searches = len({round(share * budget.geometry.steps) for share in rules.hidden_at})
    return (
        StepKind("round of density control", rounds, whole_rounds),
        StepKind("step that looks for hidden surfels", frozenset({PRUNED_AFTER - 1} if searches else ()), searches),
    )


def _kinds(rare: tuple[StepKind, ...], steps: int, short: int) -> tuple[StepKind, ...]:
    """The usual steps of a stage, and each kind of ``rare`` steps that occurs."""
    usual = frozenset(range(short)).difference(*(kind.steps for kind in rare))
    return StepKind("step", usual, steps - sum(kind.whole for kind in rare)), *(kind for kind in rare if kind.steps)
