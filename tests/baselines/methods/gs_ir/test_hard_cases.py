"""Hard cases of ``hard_cases.catalogue`` for GS-IR; test names contain the number of the case."""

import pytest
import torch

from baselines.methods.gs_ir.world import baked, lit, model_of, trained
from baselines.methods.irgs.world import DOWN, grey, middle, sheet, tiles, together
from hard_cases.constructions import looking_along_z, two_balls
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_baselines.methods.gs_ir.volumes import IrradianceVolume, Lattice


def test_case_24_a_plane_hardly_occludes_itself() -> None:
    """A floor of overlapping tiles loses a few percent to the cut-off at degree 3, as much as one whole sheet."""
    origin, up = torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])
    found, whole = (float(baked(each).openness(origin, up, 256)) for each in (tiles(), sheet(0.0)))
    assert whole > 0.93
    assert found == pytest.approx(whole, abs=0.02)


@pytest.mark.parametrize("level", [0.3, 1.0, 7.0])
def test_case_28_a_white_furnace_shows_the_albedo_plus_the_lobe(level: float) -> None:
    """Albedo enters linearly: without occlusion, and with occlusion and irradiance as bright as the sky."""
    occlusion = baked(together(sheet(0.0), sheet(0.3, DOWN, scale=1e4)))
    for volumes in ({}, {"occlusion": occlusion, "irradiance": lit(level)}):
        low, high = (
            middle(trained(model_of(sheet(0.0, albedo=albedo), grey(level), **volumes)).prepare())
            for albedo in (0.2, 0.9)
        )
        gain = sum(high[name] - low[name] for name in ("direct", "indirect"))
        torch.testing.assert_close(gain, torch.full((3,), 0.7 * level), rtol=1e-4, atol=0)


def test_case_37_zero_irradiance_equals_indirect_light_off() -> None:
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    lattice = Lattice.over(surfels, 12)
    occlusion = bake(surfels, lattice, Reach(tau=1.0), 64)
    dark, off = (
        trained(model_of(surfels, occlusion=occlusion, irradiance=volume)).prepare().render(looking_along_z())
        for volume in (IrradianceVolume.dark(lattice.of(5)), None)
    )
    assert all(torch.equal(dark[name], off[name]) for name in dark)


def test_case_40_a_volume_over_sheets_that_face_each_other_is_finite() -> None:
    opposite = together(sheet(0.0, scale=1.0, opacity=0.5), sheet(0.0, DOWN, scale=1.0))
    volume = bake(opposite, Lattice.over(opposite, 8), Reach(tau=1.0), 64)
    assert torch.isfinite(volume.openness(torch.zeros(1, 3), torch.zeros(1, 3), 16)).all()
