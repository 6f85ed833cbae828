"""Hard cases of ``hard_cases.catalogue`` for SVG-IR; test names contain the number of the case."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.methods.adapters import assert_finite
from baselines.methods.irgs.world import grey, looking_down, sheet, tiles
from baselines.methods.svg_ir.world import DISTANCE, floor, model_of, own
from radiogs_baselines.methods.svg_ir.shading import materials_of
from radiogs_baselines.methods.svg_ir.showing import Lit, Renderer
from radiogs_baselines.methods.svg_ir.table import Walk, table_of

Maps = dict[str, Tensor]


def test_case_24_a_plane_never_shadows_itself() -> None:
    """A floor of overlapping coplanar surfels receives all of the light and no indirect light."""
    plane = tiles(radiance=0.5)
    table = table_of(plane, Walk(None, 0.01, 10.0, 0.2, 10.0), 32, 0)
    assert bool((table.visibility == 1).all())
    assert not table.radiance.any()


@pytest.mark.parametrize("samples", [1, 2, 7, 64])
def test_case_28_a_white_furnace_shows_the_albedo_plus_the_lobe(samples: int) -> None:
    """Albedo enters linearly and exactly for any number of rays."""
    low, high = (own(floor(albedo), samples=samples)["direct"] for albedo in (0.2, 0.9))
    torch.testing.assert_close(high - low, torch.full((3,), 0.7), rtol=1e-5, atol=0)


def test_case_40_vertex_normals_that_cancel_receive_no_light() -> None:
    """The offset cancels the surfel's normal."""
    model = model_of(sheet(0.0, scale=0.5), grey())
    none = replace(model, vertex_offset=-model.surfels.frame[:, None, :, 2].repeat(1, 4, 1))
    table = table_of(model.surfels, Walk(None, 0.0, 1.0, 0.2, 10.0), 16, 0)
    maps = Renderer(none, materials_of(none, none.albedo), Lit(none.environment, table, 1.0), DISTANCE).render(
        looking_down(1.0, 5)
    )
    assert_finite(maps)
    assert not maps["image"].any()
