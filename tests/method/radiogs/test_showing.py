"""The key of a stage depends on the modules that train it, not on those that render: a new map retrains no stage."""

import pytest

from radiogs.method import RADIOGS
from radiogs.settings import Variant
from radiogs_bench.sources import installed
from radiogs_core.contract import StageSpec

SHOWING = {
    "radiogs.showing",
    "radiogs.relighting",
    "radiogs.varying",
    "radiogs_core.surfels.display_harmonics",
    "radiogs_core.surfels.ply",
    "radiogs_core.transport.maps",
}

STAGES = RADIOGS.stages(Variant(), RADIOGS.presets["smoke"])


@pytest.mark.parametrize("stage", STAGES, ids=[stage.name for stage in STAGES])
def test_the_sources_of_a_stage_exclude_the_modules_that_render(stage: StageSpec) -> None:
    assert not SHOWING & installed().closure(*stage.sources).keys()


def test_the_sources_of_the_method_include_the_modules_that_render() -> None:
    assert installed().closure(*RADIOGS.sources).keys() >= SHOWING
