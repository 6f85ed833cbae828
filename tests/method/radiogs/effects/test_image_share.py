"""Shares of surfels in images agree with the rendered images."""

import pytest
import torch

from radiogs.effects.image_share import image_share
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.splatting import splat
from scenes import look_at, surfels_facing

CAMERAS = [
    look_at(torch.tensor(position), torch.zeros(3), 24, 30.0)
    for position in ([0.0, 0.5, 3.0], [1.0, -0.5, 2.5], [2.0, 0.0, 2.0])
]


def scattered(count: int = 60) -> Surfels:
    drawn = torch.Generator().manual_seed(0)
    normal = torch.nn.functional.normalize(torch.randn(count, 3, generator=drawn) + torch.tensor([0, 0, 2.0]), dim=-1)
    surfels = surfels_facing(0.6 * torch.randn(count, 3, generator=drawn), normal)
    surfels.opacity_logit = torch.randn(count, generator=drawn)
    return surfels


def test_a_channels_mean_over_images_equals_its_mean_weighted_by_shares() -> None:
    surfels = scattered()
    share = image_share(CAMERAS, surfels)
    channel = torch.rand(len(surfels), 1, generator=torch.Generator().manual_seed(1))
    seen = [splat(camera, surfels, {"any": channel}, 1.0) for camera in CAMERAS]
    blended, covered = (sum(float(part.double().sum()) for part in parts) for parts in (
        [each.images["any"] for each in seen], [each.alpha for each in seen],
    ))  # fmt: skip
    assert float(share.sum()) == pytest.approx(1, rel=1e-5)
    assert float((share * channel[:, 0]).sum()) == pytest.approx(blended / covered, rel=1e-5)


def test_hidden_surfels_and_surfels_out_of_view_have_no_share() -> None:
    down = torch.linspace(0, -0.5, 6)
    stack = torch.stack([torch.zeros(6), torch.zeros(6), down], -1)
    centre = torch.cat([stack, torch.tensor([[0.0, 0.0, 9.0]])])
    surfels = surfels_facing(centre, torch.tensor([0.0, 0.0, 1.0]).expand(7, 3))
    surfels.opacity_logit[:] = 6.0
    surfels.log_scale[:] = 1.5  # nearly a plane
    share = image_share([look_at(torch.tensor([0.0, 0.01, 3.0]), torch.zeros(3), 24, 60.0)], surfels)
    assert float(share[0]) > 0.9
    assert float(share[:2].sum()) == pytest.approx(1, abs=1e-3)
    assert float(share[6]) == 0


def test_shares_are_zero_if_no_surfel_is_visible() -> None:
    away = look_at(torch.tensor([0.0, 0.5, 3.0]), torch.tensor([0.0, 0.5, 9.0]) + 0.1, 24, 30.0)
    assert not image_share([away], scattered()).any()
