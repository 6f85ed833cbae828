"""All suites that come with the package, by name."""

from collections.abc import Mapping
from difflib import get_close_matches

from radiogs_core.errors import UsageError

from .baselines import BASELINE_ABLATIONS, BASELINES
from .data_sets import DATA_SET_SUITES
from .own import COST_OF_ACCURACY, EFFECTS_SUITE, FINETUNE, ORACLES
from .paper import (
    ABLATIONS,
    EFFICIENCY,
    FORWARD_PARITY_SUITE,
    INDIRECT,
    INIT,
    NG,
    NS,
    PROFILES_SUITE,
    RELIGHT_COST,
    STABILITY_SUITE,
    STRATEGIES,
    VIEWS,
)
from .suite import Suite

SUITES: Mapping[str, Suite] = {
    suite.name: suite
    for suite in (
        ABLATIONS, STRATEGIES, VIEWS, INIT, INDIRECT, NG, NS, PROFILES_SUITE, RELIGHT_COST, EFFICIENCY, FINETUNE,
        COST_OF_ACCURACY, EFFECTS_SUITE, ORACLES, FORWARD_PARITY_SUITE, STABILITY_SUITE, *DATA_SET_SUITES,
        BASELINES, *BASELINE_ABLATIONS,
    )
}  # fmt: skip


def suite(name: str) -> Suite:
    """The suite of that name. Raises UsageError for an unknown one, with the nearest name."""
    if name not in SUITES:
        # Several tables of one data set are several suites, which share its name.
        near = [each for each in SUITES if each.startswith(f"{name}-")] or get_close_matches(name, SUITES, 1)
        raise UsageError(
            f"unknown suite '{name}'",
            f"Did you mean {' or '.join(map(repr, near))}?" if near else f"Suites: {', '.join(SUITES)}.",
            "See them all:  radiogs-bench run --list",
        )
    return SUITES[name]
