"""Where rays start and end: behind what is the same surface, before all else however near, and at what is solid."""

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases.constructions import joined
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid
from radiogs_core.transport.tracer import SurfelTracer
from scenes import surfels_facing

DEVIATION = 0.1
"""Standard deviation of the surfels that ``surfels_facing`` makes."""

UP = torch.tensor([0.0, 0.0, 1.0])


def sheet(side: int, spacing: float, height: float, normal: Tensor) -> Surfels:
    """Square of surfels around the z axis; the one in the middle comes first."""
    place = (torch.arange(side) - side // 2) * spacing
    across, along = torch.meshgrid(place, place, indexing="ij")
    centre = torch.stack([across, along, torch.full_like(across, height)], -1).reshape(-1, 3)
    centre = centre[centre.norm(dim=-1).argsort(stable=True)]
    return surfels_facing(centre, normal.expand(len(centre), 3).contiguous())


def sight(surfels: Surfels, chosen: int, direction: Tensor) -> float:
    index = torch.tensor([chosen])
    found = SurfelTracer(surfels).incident(index, direction.expand(1, 1, 3).contiguous(), torch.ones(1, 1))
    return float(found.visibility)


def under_a_lid(height: float) -> tuple[Surfels, Surfels]:
    """A plane, and with it a small lid over its middle; ``height``: in standard deviations of the plane's surfels."""
    floor = sheet(13, 0.12, 0.0, UP)
    # Not quite straight down: a rotation by half a turn from +Z has no single axis.
    lid = sheet(5, 0.04, height * DEVIATION, normalize(torch.tensor([0.01, 0.0, -1.0]), dim=0))
    return floor, joined(floor, lid)


@pytest.mark.parametrize("height", [1.5, 2.0, 3.0])
def test_a_small_occluder_close_to_a_plane_is_found(height: float) -> None:
    floor, both = under_a_lid(height)
    assert sight(both, 0, UP) == 0.0
    assert sight(both, len(floor) - 1, UP) == 1.0
    assert sight(floor, 0, UP) == 1.0


def test_surfels_within_a_standard_deviation_are_the_same_surface() -> None:
    _, both = under_a_lid(0.6)
    assert sight(both, 0, UP) == 1.0


@pytest.mark.parametrize(("opacity", "count", "left"), [(0.9, 1, 0.1), (0.8, 2, 0.04), (0.9, 2, 0.0), (0.7, 3, 0.0)])
def test_light_passes_until_less_than_three_percent_is_left(opacity: float, count: int, left: float) -> None:
    """Through surfels one behind another over the middle of a plane."""
    floor = sheet(1, 0.1, 0.0, UP)
    veils = floor
    for place in range(count):
        veil = sheet(1, 0.1, 2.0 + 0.1 * place, normalize(torch.tensor([1e-4, 0.0, -1.0]), dim=0))
        veil.opacity_logit = torch.full((1,), inverse_sigmoid(opacity))
        veils = joined(veils, veil)
    assert sight(veils, 0, UP) == pytest.approx(left, abs=1e-3)
