"""How open a surfel is to light: the cosine-weighted mean of V, against cones whose share is known."""

import math
from unittest.mock import patch

import pytest
import torch

from radiogs_core.transport import hit_surface
from radiogs_core.transport import tracer as tracing
from radiogs_core.transport.hit_surface import enclosed, openness, traced_openness
from radiogs_core.transport.incident import unoccluded
from radiogs_core.transport.plan import EffectPlan
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import SurfelTracer, gather_incident
from radiogs_datasets.generate.materials import Material
from radiogs_datasets.generate.solids import Box
from scenes import surfels_over

CLAY = Material((0.5, 0.35, 0.25), 0.5)

NORMAL = torch.nn.functional.normalize(torch.tensor([[0.3, -0.5, 0.8], [0.0, 0.0, -1.0]]), dim=-1)


@pytest.mark.parametrize("half_angle", [20.0, 45.0, 70.0])
def test_a_cone_around_the_normal_is_the_square_of_its_sine(half_angle: float) -> None:
    incident = unoccluded(*hemisphere_directions(NORMAL, 4096, None))
    cosine = (incident.direction * NORMAL[:, None]).sum(-1)
    incident.visibility = (cosine > math.cos(math.radians(half_angle))).float()
    assert openness(NORMAL, incident).tolist() == pytest.approx([math.sin(math.radians(half_angle)) ** 2] * 2, abs=4e-3)


@pytest.mark.slow
def test_openness_is_the_same_when_rays_are_traced_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    solids = [Box((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0), CLAY), Box((-1.0, -0.4, 0.0), (-0.9, 0.4, 0.8), CLAY)]
    surfels = surfels_over(solids, 0.2)
    tracer = SurfelTracer(surfels)
    hemisphere = gather_incident(tracer, surfels, 32, None)
    whole = openness(surfels.frame[..., 2], hemisphere)
    assert 0.05 < float(whole.min()) < float(whole.median()) - 0.2  # the corner is darker than the open floor
    monkeypatch.setattr(hit_surface, "RAYS_AT_ONCE", 7 * 32)
    monkeypatch.setattr(tracing, "RAYS_AT_ONCE", 3 * 32)
    with patch.object(tracer, "incident", side_effect=tracer.incident) as traced:
        torch.testing.assert_close(traced_openness(tracer, surfels, 32, False, EffectPlan()), whole)
    assert max(len(call.args[0]) for call in traced.call_args_list) == 3


def test_ends_are_exact_and_half_transparent_counts_half() -> None:
    incident = unoccluded(*hemisphere_directions(NORMAL, 64, None))
    for visibility in (0.0, 0.5, 1.0):
        incident.visibility = torch.full_like(incident.weight, visibility)
        assert openness(NORMAL, incident).tolist() == pytest.approx([visibility] * 2, abs=1e-6)


def test_directions_below_the_horizon_alone_are_no_nan() -> None:
    incident = unoccluded(*hemisphere_directions(-NORMAL, 16, None))
    assert openness(NORMAL, incident).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_light_in_an_enclosure_is_the_sum_over_its_bounces(share: float) -> None:
    albedo, is_open = torch.tensor([[0.0, 0.3, 0.9]], dtype=torch.float64), torch.tensor([[share]], dtype=torch.float64)
    bounces = sum(share * (albedo * (1 - share)) ** number for number in range(400))
    torch.testing.assert_close(enclosed(albedo, is_open), bounces, rtol=1e-6, atol=1e-12)


def test_an_enclosure_that_loses_nothing_stays_finite() -> None:
    found = enclosed(torch.ones(1, 3), torch.tensor([[1e-6]]))
    assert bool(torch.isfinite(found).all())
    assert float(found.max()) < 1
