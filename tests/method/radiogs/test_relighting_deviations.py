"""Relighting follows the variant's deviations for rays and image encoding, in each of its modes."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from known_ball import CPU, SCENE
from probed_scenes import FLOOR, cameras, grey, sheet, sky
from radiogs.model import Model
from radiogs.relighting import RelitByRays, RelitBySurfels, relight
from radiogs.settings import PRESETS, Relighting, Variant
from radiogs_core.contract import Run
from radiogs_core.kernels.image.display import displayed
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.maps import radiance_maps
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import own_radiance
from scenes import surfels_over

SPREAD = 24
BUDGET = replace(PRESETS["smoke"], relight_hemisphere_samples=SPREAD, relight_light_samples=8, finetune_iterations=40,
                 finetune_surfels=2000, finetune_samples=3)  # fmt: skip
"""A budget with so few samples of fine-tuning that none is drawn from the light."""

CAMERA = cameras()[0]
LOWEST = 0.1736
"""Sine of 10 degrees, the lowest height of the released code's directions over the hemisphere."""


def relit(
    surfels: Surfels, light: Tensor, mode: Relighting, *deviations: str, offset: float = 0.05
) -> RelitByRays | RelitBySurfels:
    run = Run(SCENE, Variant(relighting=mode, deviations=deviations, ray_offset=offset), BUDGET, 0, CPU)
    found = relight(Model(surfels, torch.zeros(8, 16, 3)), EnvironmentMap(light), torch.ones(3), run)
    assert isinstance(found, RelitByRays | RelitBySurfels)
    return found


def by_rays(mode: Relighting, *deviations: str, offset: float = 0.05) -> RelitByRays:
    """The sheet, relit by the sky."""
    found = relit(sheet(), sky(), mode, *deviations, offset=offset)
    assert isinstance(found, RelitByRays)
    return found


def floors_middle(surfels: Surfels) -> Tensor:
    """Mask of the surfels under the middle of the sheet."""
    return (surfels.centre.norm(dim=-1) < 0.2) & (surfels.frame[:, 2, 2] > 0.9)


BY_RAYS: tuple[Relighting, ...] = ("pbr", "bounces", "finetuned")


@pytest.mark.parametrize("mode", BY_RAYS)
def test_rays_hit_the_back_of_a_sheet_unless_they_are_one_sided(mode: Relighting) -> None:
    two_sided, one_sided = (by_rays(mode, *named) for named in ((), ("one-sided-rays",)))
    under = floors_middle(two_sided.surfels)
    assert float(two_sided.incident.visibility[under].mean()) < 0.75
    assert float(one_sided.incident.visibility[under].min()) > 0.99


@pytest.mark.parametrize("mode", BY_RAYS)
def test_rays_start_beyond_the_sheet_only_by_a_fixed_offset(mode: Relighting) -> None:
    assert float(by_rays(mode, offset=100.0).incident.visibility.min()) < 0.1
    assert float(by_rays(mode, "fixed-offset", offset=100.0).incident.visibility.min()) == 1.0


@pytest.mark.parametrize("mode", BY_RAYS)
def test_directions_over_the_hemisphere_have_a_floor_only_with_the_deviation(mode: Relighting) -> None:
    for named, ends in (((), False), (("hemisphere-floor",), True)):
        found = by_rays(mode, *named)
        height = (found.incident.direction * found.surfels.frame[:, None, :, 2]).sum(-1)[:, :SPREAD]
        assert (float(height.min()) > LOWEST) == ends


@pytest.mark.parametrize("mode", BY_RAYS)
def test_images_shaded_by_rays_have_the_variants_encoding(mode: Relighting) -> None:
    for named, straight in (((), True), (("premultiplied-encoding",), False)):
        maps = by_rays(mode, *named).render(CAMERA)
        linear, alpha = maps["direct"] + maps["indirect"], maps["alpha"][..., 0]
        right, wrong = (displayed(linear, alpha, each).clamp(0, 1) for each in (straight, not straight))
        assert torch.equal(maps["image"], right)
        assert float((right - wrong).abs().max()) > 0.05


def test_images_of_surfels_alone_have_the_variants_encoding() -> None:
    for named, straight in (((), True), (("premultiplied-encoding",), False)):
        found = relit(sheet(), sky(), "surfels", *named)
        assert isinstance(found, RelitBySurfels)
        right, wrong = (radiance_maps(CAMERA, found.surfels, each)["image"] for each in (straight, not straight))
        assert torch.equal(found.render(CAMERA)["image"], right)
        assert float((right - wrong).abs().max()) > 0.05


def fine_tuned_radiance(surfels: Surfels, light: Tensor, *deviations: str) -> Tensor:
    """Radiance of black surfels towards a camera above them, after fine-tuning."""
    found = relit(grey(surfels, 0.0), light, "surfels", *deviations)
    assert isinstance(found, RelitBySurfels)
    return own_radiance(CAMERA, found.surfels).mean(-1)


def test_rays_of_fine_tuning_hit_backs_as_in_the_variant() -> None:
    """With rays that hit backs, the floor below the sheet is half dark."""
    under = floors_middle(sheet())
    two_sided, one_sided = (
        float(fine_tuned_radiance(sheet(), sky(), *named)[under].mean()) for named in ((), ("one-sided-rays",))
    )
    assert 0.1 < two_sided < 0.8 * one_sided


def test_directions_of_fine_tuning_have_the_variants_floor() -> None:
    """In a white furnace, the released code's directions give too much radiance, and more with fewer directions."""
    floor = surfels_over([FLOOR], 0.2)
    floor = floor.take(torch.nonzero(floor.frame[:, 2, 2] > 0.9)[:, 0])
    white = torch.ones(8, 16, 3)
    whole, brighter = (float(fine_tuned_radiance(floor, white, *named).mean()) for named in ((), ("hemisphere-floor",)))
    up = torch.tensor([[0.0, 0.0, 1.0]])
    direction, weight = hemisphere_directions(up, BUDGET.finetune_samples, None, floor=True)
    excess = float((direction[..., 2] * weight).sum() / math.pi)
    assert excess > 1.1
    assert brighter / whole == pytest.approx(excess, rel=0.05)
