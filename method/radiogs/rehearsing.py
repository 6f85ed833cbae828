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

    They fill the visual hull, as at the start of any run; those of a trained model lie on surfaces.
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
    rules = variant.surfel_learning.density
    rounds = frozenset(
        done - 1
        for done in range(DENSIFY_EVERY, INITIALISE_STEPS, DENSIFY_EVERY)
        if rules.start <= done / INITIALISE_STEPS < rules.end
    )
    whole_rounds = int((rules.end - rules.start) * budget.initialise_iterations / budget.densify_interval)
    kinds = {
        "initialise": _kinds(
            "round of density control", rounds, whole_rounds, budget.initialise_iterations, INITIALISE_STEPS
        ),
        "invert": (StepKind("step", frozenset(range(INVERT_STEPS)), budget.inverse_iterations),),
    }
    if variant.shading == "monte-carlo" and variant.incident != "precomputed":
        refreshed, whole = frozenset({REFRESH_EVERY}), (budget.inverse_iterations - 1) // budget.refresh_interval
        title = "step that traces all light anew"
        kinds["invert"] = _kinds(title, refreshed, whole, budget.inverse_iterations, INVERT_STEPS)
    modes = [mode for mode in get_args(Mode) if mode in TITLES]
    steps = {mode: 0 if mode == "pbr" else budget.finetune_iterations for mode in modes}
    ways = tuple(Relighting(TITLES[mode], replace(variant, relighting=mode), steps[mode]) for mode in modes)
    return ShortRun(short, kinds, ways)


def _kinds(title: str, rare: frozenset[int], rare_whole: int, steps: int, short: int) -> tuple[StepKind, ...]:
    """The rare steps of a stage, and all others."""
    return (
        StepKind("step", frozenset(range(short)) - rare, steps - rare_whole),
        StepKind(title, rare, rare_whole),
    )
