"""Relighting mode "direct" has the shadows of the full method and no light from other surfaces."""

import torch

from known_ball import BUDGET, CPU, SCENE
from radiogs.method import RADIOGS
from radiogs.model import Model
from radiogs.relighting import relight
from radiogs.settings import Relighting, Variant
from radiogs_core.contract import Maps, Run
from radiogs_core.scene.light import EnvironmentMap
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box, Sphere
from scenes import surfels_over

CLAY = Material((0.5, 0.35, 0.25), 0.9)
SURFELS = surfels_over([Sphere((0.0, 0.0, 0.0), 1.0, CLAY), Box((-2.0, -2.0, -1.5), (2.0, 2.0, -1.4), CLAY)], 0.25)


def shown(mode: Relighting) -> Maps:
    run = Run(SCENE, Variant(relighting=mode), BUDGET, 0, CPU)
    model = Model(SURFELS, torch.zeros(8, 16, 3))
    return relight(model, EnvironmentMap(torch.ones(8, 16, 3)), torch.ones(3), run).render(SCENE.test[0].camera)


def test_direct_light_is_that_of_the_full_method_and_indirect_light_is_zero() -> None:
    direct, full = shown("direct"), shown("pbr")
    torch.testing.assert_close(direct["direct"], full["direct"], rtol=1e-5, atol=1e-6)
    assert float(full["indirect"].max()) > 0.01
    assert not direct["indirect"].any()


def test_the_method_offers_it() -> None:
    assert "direct" in RADIOGS.relighting_modes.titles
