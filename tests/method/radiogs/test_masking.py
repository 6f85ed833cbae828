"""The masking of the variant reaches every split sum: in both stages, in rendering, and of what relit rays hit."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from known_ball import BALL, CPU, SCENE, initialisation, inverse_rendering
from probed_scenes import CLAY, FLOOR, cameras, sky
from radiogs.model import Model
from radiogs.relighting import relight
from radiogs.settings import PRESETS, Variant
from radiogs.showing import Renderer
from radiogs.varying import VaryingRadioGS
from radiogs_core.contract import Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.transport.prefiltered_light import Masking
from radiogs_datasets.generate.solids import Sphere
from scenes import surfels_over

CAMERA = SCENE.test[0].camera
BUDGET = replace(PRESETS["smoke"], relight_hemisphere_samples=24, relight_light_samples=8)


def variant(masking: Masking) -> Variant:
    return Variant(masking=masking, shading="split-sum")


def of_stage_1(masking: Masking) -> float:
    return initialisation(BALL, 0.9, variant(masking)).step()["shaded"]


def of_stage_2(masking: Masking) -> float:
    return inverse_rendering(BALL, 0.9, variant(masking)).step()["shaded"]


def consistency_of_stage_2(masking: Masking) -> float:
    return inverse_rendering(BALL, 0.9, variant(masking)).step()["consistency"]


def rendered(masking: Masking) -> float:
    maps = Renderer(Model(BALL, torch.zeros(8, 16, 3)), 8, variant(masking)).render(CAMERA)
    return float(maps["direct"].mean())


def relit(masking: Masking) -> float:
    run = Run(SCENE, Variant(masking=masking, relighting="pbr"), BUDGET, 0, CPU)
    surfels = surfels_over([FLOOR, Sphere((0.0, 0.0, 0.5), 0.3, CLAY)], 0.12)
    found = relight(Model(surfels, torch.zeros(8, 16, 3)), EnvironmentMap(sky()), torch.ones(3), run)
    return float(found.render(cameras()[0])["indirect"].mean())


def varied(masking: Masking) -> float:
    made = VaryingRadioGS(Model(BALL, torch.zeros(8, 16, 3)), None, [CAMERA], variant(masking))
    return float(made.images("roughness", 0.0)[0].mean())


@pytest.mark.slow
@pytest.mark.parametrize("found", [of_stage_1, of_stage_2, consistency_of_stage_2, rendered, relit, varied])
def test_the_exact_masking_changes_what_is_shaded_by_the_split_sum(found: Callable[[Masking], float]) -> None:
    schlick, exact = found("schlick"), found("height-correlated")
    assert abs(exact - schlick) > 2e-4 * schlick
    assert found("schlick") == schlick
