"""Few steps of every kind at full size, for a rehearsal of a long run (``radiogs_core.capabilities.Rehearsing``)."""

from dataclasses import replace
from typing import get_args

from radiogs_core.capabilities import Relighting, ShortRun, StepKind

from .budget import Budget
from .variant import Relighting as Mode
from .variant import Variant

INITIALISE_STEPS = 12
"""Steps of stage 1: schedules go by the share of steps that are done, so that every harmonic and loss has its turn."""

DENSIFY_EVERY = 3
"""Steps between two of its rounds of density control."""

PRUNED_AFTER = 11
"""Steps of stage 1 after which surfels that hardly show are looked for in all training views: no round is due then."""

INVERT_STEPS = 6
"""Steps of stage 2."""

REFRESH_EVERY = 4
"""Steps after which all light is traced anew."""

FINETUNE_STEPS = 3
"""Steps of fine-tuning: the first, which is not counted, and two that are."""

TITLES = {
    "pbr": "by rays, split sum",
    "finetuned": "by rays, fine-tuned",
    "surfels": "by surfels alone, fine-tuned",
}


def sizes(budget: Budget) -> tuple[int, int]:
    """Surfels at the start, and at most."""
    return min(budget.initial_surfels, budget.maximum_surfels), budget.maximum_surfels


def short_run(variant: Variant, budget: Budget, size: int) -> ShortRun:
    """A run that begins with ``size`` surfels and may not have more.

    They fill the visual hull, whatever the variant starts from; those of a trained model lie on surfaces. Those that
    hardly show are looked for once, and stay: most of a hull hardly shows, and the model is to keep its size.
    """
    short = replace(
        budget,
        initial_surfels=size,
        maximum_surfels=size,
        initialise_iterations=INITIALISE_STEPS,
        densify_interval=DENSIFY_EVERY,
        inverse_iterations=INVERT_STEPS,
        refresh_interval=REFRESH_EVERY,
        finetune_iterations=min(FINETUNE_STEPS, budget.finetune_iterations),
    )
    kinds = {
        "initialise": _kinds(_density_kinds(variant, budget), budget.initialise_iterations, INITIALISE_STEPS),
        "invert": _kinds((), budget.inverse_iterations, INVERT_STEPS),
    }
    if variant.shading == "monte-carlo" and variant.incident != "precomputed":
        refreshed, whole = frozenset({REFRESH_EVERY}), (budget.inverse_iterations - 1) // budget.refresh_interval
        tracing = StepKind("step that traces all light anew", refreshed, whole)
        kinds["invert"] = _kinds((tracing,), budget.inverse_iterations, INVERT_STEPS)
    modes = [mode for mode in get_args(Mode) if mode in TITLES]
    steps = {mode: 0 if mode == "pbr" else budget.finetune_iterations for mode in modes}
    rehearsed = _in_the_hull(_pruning_once(variant))
    ways = tuple(Relighting(TITLES[mode], replace(rehearsed, relighting=mode), steps[mode]) for mode in modes)
    return ShortRun(rehearsed, short, kinds, ways)


def _pruning_once(variant: Variant) -> Variant:
    """Surfels that hardly show are looked for once in the short stage 1, if ever, and none is removed."""
    rules = variant.geometry.density
    once = replace(
        rules, hidden_at=(PRUNED_AFTER / INITIALISE_STEPS,) if rules.hidden_at else (), least_contribution=0.0
    )
    return replace(variant, geometry=replace(variant.geometry, density=once))


def _in_the_hull(variant: Variant) -> Variant:
    """Surfels start in the visual hull, where there are as many as are asked for; images have points for fewer."""
    start = replace(variant.geometry.start, points="hull")
    return replace(variant, geometry=replace(variant.geometry, start=start))


def _density_kinds(variant: Variant, budget: Budget) -> tuple[StepKind, ...]:
    """Steps of stage 1 with a round of density control, and with a look at all training views.

    A step with both counts as one of each: what they add to a usual step adds up.
    """
    rules = variant.geometry.density
    rounds = frozenset(
        done - 1
        for done in range(DENSIFY_EVERY, INITIALISE_STEPS, DENSIFY_EVERY)
        if rules.start <= done / INITIALISE_STEPS < rules.end
    )
    whole_rounds = int((rules.end - rules.start) * budget.initialise_iterations / budget.densify_interval)
    looks = len({round(share * budget.initialise_iterations) for share in rules.hidden_at})
    return (
        StepKind("round of density control", rounds, whole_rounds),
        StepKind("step that looks for hidden surfels", frozenset({PRUNED_AFTER - 1} if looks else ()), looks),
    )


def _kinds(rare: tuple[StepKind, ...], steps: int, short: int) -> tuple[StepKind, ...]:
    """The usual steps of a stage, and the rare ones."""
    usual = frozenset(range(short)).difference(*(kind.steps for kind in rare))
    return StepKind("step", usual, steps - sum(kind.whole for kind in rare)), *(kind for kind in rare if kind.steps)
