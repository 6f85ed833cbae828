"""Hard cases of ``hard_cases.catalogue`` for IRGS; test names contain the number of the case."""

import pytest
import torch

from baselines.methods.irgs.world import UP, grey, looking_down, own, sheet, tiles, trained
from hard_cases.constructions import looking_along_z, two_balls


def test_case_24_a_plane_never_shadows_itself() -> None:
    """A floor of overlapping coplanar surfels receives all of the light and no indirect light."""
    floor = tiles(radiance=0.5)
    maps = trained(floor, ray_start=None, two_sided=True).prepare().render(looking_down(0.5))
    assert bool((maps["indirect"] == 0).all())
    alone = own(sheet(0.0, UP, opacity=0.9), grey())["direct"]
    torch.testing.assert_close(maps["direct"][1, 1] / maps["alpha"][1, 1], alone, rtol=0.02, atol=0)


@pytest.mark.parametrize("samples", [1, 2, 7, 64])
def test_case_28_a_white_furnace_shows_the_albedo_plus_the_lobe(samples: int) -> None:
    """Albedo enters linearly and exactly for any number of rays."""
    low, high = (own(sheet(0.0, albedo=albedo), grey(), samples=samples)["direct"] for albedo in (0.2, 0.9))
    torch.testing.assert_close(high - low, torch.full((3,), 0.7), rtol=1e-5, atol=0)


def test_case_37_surfels_without_radiance_equal_indirect_light_off() -> None:
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    surfels.sh = torch.zeros_like(surfels.sh)
    surfels.sh[:, 0] = -10.0  # far below zero: clamped
    traced, off = (
        trained(surfels, samples=16, indirect=indirect).prepare().render(looking_along_z())
        for indirect in ("traced", "none")
    )
    assert all(torch.equal(traced[name], off[name]) for name in traced)
