"""How open a surfel is to light: the cosine-weighted mean of V, against cones whose share is known."""

import math

import pytest
import torch

from radiogs_core.transport.incident import unoccluded
from radiogs_core.transport.met_surface import openness
from radiogs_core.transport.sampling import hemisphere_directions

NORMAL = torch.nn.functional.normalize(torch.tensor([[0.3, -0.5, 0.8], [0.0, 0.0, -1.0]]), dim=-1)


@pytest.mark.parametrize("half_angle", [20.0, 45.0, 70.0])
def test_a_cone_around_the_normal_is_the_square_of_its_sine(half_angle: float) -> None:
    incident = unoccluded(*hemisphere_directions(NORMAL, 4096, None))
    cosine = (incident.direction * NORMAL[:, None]).sum(-1)
    incident.visibility = (cosine > math.cos(math.radians(half_angle))).float()
    assert openness(NORMAL, incident).tolist() == pytest.approx([math.sin(math.radians(half_angle)) ** 2] * 2, abs=4e-3)


def test_ends_are_exact_and_half_transparent_counts_half() -> None:
    incident = unoccluded(*hemisphere_directions(NORMAL, 64, None))
    for visibility in (0.0, 0.5, 1.0):
        incident.visibility = torch.full_like(incident.weight, visibility)
        assert openness(NORMAL, incident).tolist() == pytest.approx([visibility] * 2, abs=1e-6)


def test_directions_below_the_horizon_alone_are_no_nan() -> None:
    incident = unoccluded(*hemisphere_directions(-NORMAL, 16, None))
    assert openness(NORMAL, incident).tolist() == [0.0, 0.0]
