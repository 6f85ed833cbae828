"""The light that stage 2 begins under: what its search simulates, and whether it is held or learnt."""

from typing import Any

import pytest
import torch

from radiogs.initialise import Initialisation
from radiogs.invert import InverseRendering
from radiogs.method import inverse_rendering
from radiogs.settings import Variant
from radiogs_core.contract import Run
from radiogs_core.instruments import recording
from radiogs_core.plain_values import with_values
from short_training import BUDGET, CPU, SCENE, through_a_file


@pytest.fixture(scope="module")
def initialised() -> dict[str, Any]:
    stage = Initialisation(Run(SCENE, Variant(), BUDGET, 0, CPU))
    for _ in range(stage.iterations):
        stage.step()
    return through_a_file(stage.product())


def begun(initialised: dict[str, Any], **changed: Any) -> InverseRendering:
    return inverse_rendering(Run(SCENE, with_values(Variant(), changed), BUDGET, 0, CPU), initialised)


@pytest.mark.parametrize(
    ("changed", "traces"),
    [
        ({}, True),
        ({"shading": "split-sum"}, False),
        ({"effects": ("specular",)}, False),
        ({"effects": ("visibility",)}, True),
        ({"effects": "auto"}, True),
    ],
    ids=["default", "split-sum", "specular", "visibility", "auto"],
)
def test_the_search_for_the_light_traces_rays_only_where_stage_2_does(
    initialised: dict[str, Any], changed: dict[str, Any], traces: bool
) -> None:
    with recording() as counted:
        start = begun(initialised, **changed).start
    assert not torch.equal(start.log_environment, start.log_environment.mean().expand_as(start.log_environment))
    assert (counted.work["rays"] > 0) == traces


@pytest.mark.parametrize(
    ("changed", "rate", "learnt"),
    [
        ({}, 0.0, False),
        ({"materials.rates.light": 0.0005}, 0.0005, True),
        ({"materials.start.light": "constant"}, 0.01, True),
        ({"deviations": ("start-light",)}, 0.01, True),
    ],
    ids=["searched", "searched-and-learnt", "constant", "start-light"],
)
def test_a_light_that_was_searched_for_is_held_and_a_constant_one_is_learnt(
    initialised: dict[str, Any], changed: dict[str, Any], rate: float, learnt: bool
) -> None:
    stage = begun(initialised, **changed)
    before = stage.model.log_environment.detach().clone()
    for _ in range(3):
        stage.step()
    assert stage.optimiser.rates["log_environment"] == rate
    assert (not torch.equal(stage.model.log_environment, before)) == learnt
