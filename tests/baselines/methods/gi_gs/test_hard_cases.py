"""Hard cases of ``hard_cases.catalogue`` for GI-GS; test names contain the number of the case."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.gi_gs.world import block, light_of, march, shader, shown
from baselines.methods.irgs.world import looking_down, sheet, together
from baselines.methods.stage_two import GI_GS
from hard_cases.constructions import looking_along_z, two_balls
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.prefiltered_light import PrefilteredLight

Maps = dict[str, Tensor]


def random_light(rows: int = 8) -> SplitSumLight:
    torch.manual_seed(4)
    return SplitSumLight(PrefilteredLight(torch.randn(rows, 2 * rows, 3).exp()))


def test_case_22_a_step_on_images_of_one_row() -> None:
    """Such images have neighbours along only one axis."""
    stage = GI_GS.stage_of()
    view = stage.views[0]
    row = Camera(view.camera.camera_to_world, view.camera.fx, view.camera.fy, view.camera.cx, 0.5, 24, 1)
    losses = stage.losses(replace(view, camera=row, pixels=view.image[12:13], covered=view.mask[12:13]))
    assert all(bool(torch.isfinite(value)) for value in losses.values())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_case_24_a_plane_seen_from_above_never_shadows_itself(dtype: torch.dtype) -> None:
    """All of the light arrives, and there is no bounce. At grazing angles the depth of neighbouring pixels differs by
    more than the published bias, and the method does shadow planes by themselves.
    """
    floor = sheet(0.0, dtype=dtype)
    camera = looking_down(2.0, 15, dtype=dtype)
    maps = shown(floor, camera, light_of(1.0, dtype=dtype), shader(marches=march(thick=0.05)))
    free = shown(floor, camera, light_of(1.0, dtype=dtype), shader(occlusion=False))
    assert not maps["indirect"].any()
    assert torch.equal(maps["direct"], free["direct"])


@pytest.mark.parametrize("rows", [4, 16, 64])
def test_case_28_a_white_furnace_shows_the_albedo_plus_the_lobe(rows: int) -> None:
    """Albedo enters linearly and exactly, on maps of any size, including those that are downsampled."""
    low, high = (
        shown(sheet(0.0, albedo=albedo), looking_down(), light_of(1.0, rows), shader(False, False))
        for albedo in (0.2, 0.9)
    )
    alpha = low["alpha"][1, 1]
    torch.testing.assert_close((high["direct"] - low["direct"])[1, 1] / alpha, torch.full((3,), 0.7), rtol=1e-4, atol=0)


def test_case_37_black_surfaces_equal_indirect_light_off() -> None:
    """Images are equal bit for bit."""
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    surfels.albedo_logit = torch.full_like(surfels.albedo_logit, -200.0)
    camera, light = looking_along_z(), random_light()
    with_it, off = (shown(surfels, camera, light, shader(indirect=indirect)) for indirect in (True, False))
    assert all(torch.equal(with_it[name], off[name]) for name in ("image", "direct", "indirect"))


def test_a_frame_does_not_depend_on_the_size_of_the_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    surfels = Surfels.of(together(sheet(0.0), block(1.0, 0.1, 1.5)).parameters())
    whole = shown(surfels, looking_down(3.0, 31), random_light())
    for module in ("marching", "shading"):
        monkeypatch.setattr(f"radiogs_baselines.methods.gi_gs.{module}.LOOKUPS_AT_ONCE", 100)
    parts = shown(surfels, looking_down(3.0, 31), random_light())
    assert all(torch.equal(whole[name], parts[name]) for name in whole)
