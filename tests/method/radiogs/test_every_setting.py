"""Every value that a setting's documentation allows trains, or is refused by the setting's name."""

import math
from itertools import product
from typing import Any

import pytest
import torch

from radiogs.method import RADIOGS
from radiogs.settings import PRESETS, Variant
from radiogs_core.contract import Run
from radiogs_core.errors import DataError, UsageError
from radiogs_core.plain_values import leaf_names, value_at, with_values
from scenes import sphere_scene

CPU = torch.device("cpu")
SCENE = sphere_scene(views=4, size=16)
BUDGET = with_values(
    PRESETS["smoke"],
    {"geometry.steps": 4, "geometry.densify_interval": 2, "geometry.initial_surfels": 60, "inverse_iterations": 2},
)
FULL = Variant()


def numbers() -> list[str]:
    """The names of all settings that are numbers, or lists of numbers."""

    def is_number(value: Any) -> bool:
        return isinstance(value, int | float) and not isinstance(value, bool)

    return [
        name
        for name in leaf_names(FULL)
        if is_number(value := value_at(FULL, name))
        or (isinstance(value, tuple) and len(value) > 0 and all(map(is_number, value)))
    ]


def as_long_as(value: Any, number: float) -> Any:
    """A number in the type of a setting's value: a list for a list, a whole number for a whole number."""
    if isinstance(value, tuple):
        return [number] * len(value)
    return int(number) if isinstance(value, int) else float(number)


def refusal(name: str, number: float) -> str:
    """Train a little with a setting at ``number``; the message if it is refused. Losses have to be finite."""
    try:
        variant = with_values(FULL, {name: as_long_as(value_at(FULL, name), number)})
        run, product = Run(SCENE, variant, BUDGET, 0, CPU), {}
        for spec in RADIOGS.stages(variant, BUDGET):
            stage = spec.begin(run, product)
            while stage.iteration < stage.iterations:
                assert all(map(math.isfinite, stage.step().values()))
            product = stage.product()
    except (UsageError, DataError) as refused:
        return refused.what
    return ""


def assert_trains_or_is_refused(name: str, number: float) -> None:
    """A refusal names the setting, or states that a threshold has left no surfel."""
    said = refusal(name, number)
    assert not said or name.rpartition(".")[2] in said or "no surfel is left" in said


@pytest.mark.parametrize("name", numbers())
def test_a_negative_setting_is_refused_by_its_name(name: str) -> None:
    if name.rpartition(".")[2] in SIGNED:
        return
    with pytest.raises(UsageError, match=name.rpartition(".")[2]):
        with_values(FULL, {name: as_long_as(value_at(FULL, name), -1)})


SIGNED = {"freest"}
"""Settings that may be negative."""


SCHEDULES = [name for name in numbers() if ".schedule." in name or name.endswith(("_from", "end_share"))]
"""Shares of a stage, whose other end is one."""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [*product(numbers(), (0, 3)), *product(SCHEDULES, (1,))])
def test_every_number_of_every_setting_trains_or_is_refused_by_its_name(name: str, number: float) -> None:
    assert_trains_or_is_refused(name, number)
