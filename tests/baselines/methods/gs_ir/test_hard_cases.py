"""Hard cases of ``hard_cases.catalogue`` for GS-IR; test names contain the number of the case."""

import pytest
import torch
from torch import Tensor

from baselines.methods.gs_ir.world import baked, lit, middle, model_of, trained
from baselines.methods.irgs.world import DOWN, OPAQUE, UP, grey, looking_down, sheet, together
from hard_cases.constructions import looking_along_z, two_balls
from radiogs_baselines.methods.gs_ir.training import Reach, bake
from radiogs_baselines.methods.gs_ir.volumes import IrradianceVolume, Lattice
from radiogs_core.scene.camera import Camera
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels

Maps = dict[str, Tensor]


def shown(surfels: Surfels, camera: Camera, over: Surfels | None = None, tau: float = 1.0) -> Maps:
    """Maps under a recovered light of random texels with both volumes, which cover the surfels ``over``."""
    torch.manual_seed(4)
    light = EnvironmentMap(torch.randn(8, 16, 3).exp())
    lattice = Lattice.over(over or surfels, 12)
    occlusion = bake(over or surfels, lattice, Reach(tau=tau), 64)
    irradiance = IrradianceVolume(lattice.of(5), torch.randn(125, 9))
    model = model_of(surfels, light, occlusion=occlusion, irradiance=irradiance)
    return dict(trained(model).prepare().render(camera))


def assert_finite(maps: Maps) -> None:
    assert all(bool(torch.isfinite(value).all()) for value in maps.values())


def test_case_24_a_plane_hardly_occludes_itself() -> None:
    """A floor of overlapping tiles loses a few percent to the cut-off at degree 3, as much as one whole sheet."""
    coordinate = torch.arange(-6, 7) * 0.1
    x, y = torch.meshgrid(coordinate, coordinate, indexing="ij")
    centre = torch.stack([x.flatten(), y.flatten(), 0 * x.flatten()], -1)
    tile = sheet(0.0, UP, scale=0.1, opacity=0.9)
    floor = Surfels.of(
        {name: value.expand(len(centre), *value.shape[1:]).contiguous() for name, value in tile.parameters().items()}
        | {"centre": centre}
    )
    origin, up = torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]])
    tiles, whole = (float(baked(each).openness(origin, up, 256)) for each in (floor, sheet(0.0)))
    assert whole > 0.93
    assert tiles == pytest.approx(whole, abs=0.02)


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


def test_case_40_blended_normals_that_cancel_leave_finite_maps() -> None:
    """Two sheets of equal weight lean to opposite sides by nearly 90 degrees from the view."""
    lean = (1 - 1e-12) ** 0.5
    left = sheet(0.0, (lean, 0.0, 1e-6), scale=1.0, opacity=0.5)
    right = sheet(0.0, (-lean, 0.0, 1e-6), scale=1.0, opacity=OPAQUE)
    assert_finite(shown(together(left, right), looking_down(1.0, 5)))
    opposite = together(sheet(0.0, scale=1.0, opacity=0.5), sheet(0.0, DOWN, scale=1.0))
    volume = bake(opposite, Lattice.over(opposite, 8), Reach(tau=1.0), 64)
    assert torch.isfinite(volume.openness(torch.zeros(1, 3), torch.zeros(1, 3), 16)).all()
