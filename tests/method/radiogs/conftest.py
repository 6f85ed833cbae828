"""The end of stage 1 that tests of stage 2 begin with."""

from functools import cache
from typing import Any

import pytest

from radiogs.initialise import Initialisation
from radiogs.settings import Variant
from radiogs_core.contract import Run
from short_training import BUDGET, CPU, SCENE, through_a_file


@cache
def _end_of_stage_1() -> dict[str, Any]:
    stage = Initialisation(Run(SCENE, Variant(), BUDGET, 0, CPU))
    for _ in range(stage.iterations):
        stage.step()
    return stage.state()


@pytest.fixture(scope="module")
def initialised() -> dict[str, Any]:
    """The state of stage 1 at its end; each module has a copy."""
    return through_a_file(_end_of_stage_1())
