"""Hard cases of ``hard_cases.catalogue`` for R3DG; test names contain the number of the case."""

import pytest
import torch
from torch import Tensor

from baselines.methods.irgs.world import UP, looking_down, middle, sheet, tiles
from baselines.methods.r3dg.world import around, trained
from hard_cases.constructions import looking_along_z, two_balls


def test_case_24_a_plane_never_shadows_itself() -> None:
    """In a floor of overlapping coplanar surfels V is 1, although one of them would hide everything."""
    floor = tiles()
    shown = trained(floor, ray_start=None, two_sided=True).prepare()
    assert bool((shown.renderer.incident.visibility == 1).all())  # type: ignore[attr-defined]
    alone = trained(sheet(0.0, UP, opacity=0.9)).prepare()
    seen = [
        maps["direct"][1, 1] / maps["alpha"][1, 1]
        for maps in (each.render(looking_down(2.0)) for each in (shown, alone))
    ]
    torch.testing.assert_close(*seen, rtol=0.01, atol=0)


@pytest.mark.parametrize("samples", [1, 2, 7, 64])
def test_case_28_a_white_furnace_shows_the_albedo_plus_the_lobe(samples: int) -> None:
    """Albedo enters linearly and exactly for any number of directions; with the published elevations it does not."""

    def sent(albedo: float, **turned: bool) -> Tensor:
        return middle(trained(sheet(0.0, albedo=albedo), samples=samples, **turned).prepare())["direct"]

    torch.testing.assert_close(sent(0.9) - sent(0.2), torch.full((3,), 0.7), rtol=1e-5, atol=0)
    assert float((sent(0.9, floor=True) - sent(0.2, floor=True)).min()) > 0.7 * 1.02


def test_case_37_zero_local_light_equals_local_light_off() -> None:
    surfels = two_balls()
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 5.0])
    camera = looking_along_z()
    zero, off = (
        trained(surfels, local=around(surfels, -1.0), local_light=local).prepare().render(camera)
        for local in ("free", "none")
    )
    assert all(torch.equal(zero[name], off[name]) for name in zero)
