"""IRGS's image loss in float64 against a dense reference of the whole chain and against central differences."""

from dataclasses import replace
from functools import cache

import pytest
import torch
from torch import Tensor

from baselines.methods.dense import F64, assert_same_gradients, encode, floor, gradients, seen, surfels_of
from baselines.methods.irgs.world import DOWN, looking_down, sheet, together
from radiogs_baselines.methods.irgs.rays import RaySettings, shade_points
from radiogs_baselines.methods.irgs.settings import Indirect
from radiogs_baselines.methods.irgs.training import neutrality, pixel_loss
from radiogs_core.on_surfels.seen_points import SeenPoints, covered_pixels, seen_points, seen_surfels
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.tracer import SurfelTracer
from reference.differences import Values, assert_gradients
from reference.shade import environment_radiance, shade
from reference.trace import trace

CAMERA = looking_down(1.5, size=4, dtype=F64)
RAYS = RaySettings(0.05, two_sided=True)
SAMPLES = 24
LEARNT = ("sh", "albedo_logit", "roughness_logit", "environment")
MOVED = (*LEARNT, "centre", "opacity_logit")
"""Parameters learnt with ``lr_scale``, without rotations and scales: the directions of rays follow the normal, and
their start follows the width, both without gradient."""


@cache
def start() -> Values:
    """A floor of two overlapping surfels that the camera sees, and two sheets above the camera that it does not see."""
    torch.manual_seed(3)
    high = [sheet(2.2, DOWN, 2.0, 0.6, dtype=F64), sheet(2.6, DOWN, 3.0, 0.8, dtype=F64)]
    given = together(*floor(), *high).parameters()
    given["sh"] = given["sh"] + 0.1 * torch.randn_like(given["sh"])
    given["sh"][:, 0] += 1.0
    given["albedo_logit"] = given["albedo_logit"] + 0.3 * torch.randn_like(given["albedo_logit"])
    given["centre"] = given["centre"] + 0.05 * torch.randn_like(given["centre"])
    return given | {"environment": 0.2 + torch.rand(6, 12, 3, dtype=F64)}


@cache
def fixed() -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Pixels, directions, weights and targets, drawn once."""
    torch.manual_seed(4)
    drawn, points = points_of(surfels_of(start()))
    # A seed whose directions leave the kinks of l1 and of the clamps at zero outside all stencils.
    direction, weight = hemisphere_directions(points.normal, SAMPLES, torch.Generator().manual_seed(2))
    return covered_pixels(drawn), direction, weight, torch.rand(len(points), 3, dtype=F64)


def points_of(surfels: Surfels) -> tuple[object, SeenPoints]:
    drawn = seen_surfels(CAMERA, surfels, surfels.albedo, {})
    return drawn, seen_points(CAMERA, drawn, covered_pixels(drawn))


def losses(values: Values, indirect: Indirect = "traced") -> tuple[Tensor, Tensor]:
    """The image loss and the neutrality loss, as stage 2 computes them."""
    _, direction, weight, target = fixed()
    surfels = surfels_of(values)
    drawn, points = points_of(surfels)
    incident = RAYS.incident(SurfelTracer(surfels), points, direction, weight, indirect)
    shaded = shade_points(points, incident, values["environment"])
    alpha = drawn.alpha.flatten()[fixed()[0]]  # type: ignore[attr-defined]
    return pixel_loss(shaded.radiance, alpha, target), neutrality(incident, values["environment"])


def dense_losses(values: Values) -> tuple[Tensor, Tensor]:
    """Both losses from the formulas: rasterization, tracing, shading and encoding as dense loops."""
    pixels, direction, weight, target = fixed()
    surfels = surfels_of(values)
    traced, columns = surfels.geometry(), (surfels.albedo, surfels.roughness[:, None], surfels.scale.amax(-1, True))
    features, alpha, depth = (column[pixels] for column in seen(CAMERA, surfels, *columns))
    straight = features / alpha[:, None]
    to_pixels = CAMERA.ray_directions().flatten(0, 1)[pixels]
    position = CAMERA.centre + to_pixels * (depth / alpha)[:, None]
    normal = features[:, :3] / features[:, :3].norm(dim=-1, keepdim=True)
    arrived = [
        trace(
            traced.centre, traced.axis_u, traced.axis_v, traced.normal, traced.opacity, surfels.sh,
            traced.centre[:, :0],
            origin.expand(SAMPLES, 3), along, torch.full((SAMPLES,), 0.05, dtype=F64), 0.03, 4 * float(width),
        )[:2]
        for origin, along, width in zip(position, direction, straight[:, 7].detach(), strict=True)
    ]  # fmt: skip
    radiance, left = (torch.stack(column) for column in zip(*arrived, strict=True))
    ended = left < 0.03
    visibility = torch.where(ended, 0.0, left)
    radiance = radiance / torch.where(ended, 1 - left, 1.0)[..., None]
    outgoing = (-to_pixels / to_pixels.norm(dim=-1, keepdim=True))[:, None]
    parts = shade(
        normal, straight[:, 3:6], straight[:, 6], outgoing, direction, weight, visibility, radiance,
        values["environment"],
    )  # fmt: skip
    display = encode(parts.sum(2)[:, 0])
    light = (visibility[..., None] * environment_radiance(values["environment"], direction)).mean(1)
    apart = (light - light.mean(-1, keepdim=True)).abs().mean()
    return (display * alpha[:, None] - target).abs().mean(), apart


def test_both_losses_and_their_gradients_equal_the_formulas() -> None:
    found, expected = losses(start()), dense_losses(start())
    for mine, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=1e-10, atol=0)
    ours, theirs = (
        gradients(lambda values, of=of: torch.stack(of(values)).sum(), start(), MOVED) for of in (losses, dense_losses)
    )
    assert_same_gradients(ours, theirs, MOVED)


def hit_surfels(values: Values) -> list[bool]:
    """Whether each ray hits each surfel, flattened; where this changes, the losses are discontinuous."""
    surfels = surfels_of(values)
    geometry, (_, points), direction = surfels.geometry(), points_of(surfels), fixed()[1]
    facing = direction @ geometry.normal.T
    along = ((geometry.centre - points.position[:, None]) * geometry.normal).sum(-1)[:, None] / facing
    offset = points.position[:, None, None] + along[..., None] * direction[:, :, None] - geometry.centre
    square = (offset * geometry.axis_u).sum(-1).square() + (offset * geometry.axis_v).sum(-1).square()
    alpha = geometry.opacity * torch.exp(-0.5 * square)
    behind = along >= 4 * points.width[:, None, None]
    hits: list[bool] = ((alpha >= 1 / 255) & (along > 0.05) & ((facing < 0) | behind)).flatten().tolist()
    return hits


@pytest.mark.slow
def test_gradients_equal_central_differences() -> None:
    """Centres are compared with the formulas above: pixels' footprints follow them without gradient."""
    names = (*LEARNT, "opacity_logit")

    def total(values: Values) -> Tensor:
        return torch.stack(losses(values)).sum()

    found = gradients(total, start(), names)
    assert_gradients(lambda values: float(total(values)), start(), found, 2e-4, hit_surfels, directions=4)


def test_the_image_loss_reaches_only_the_harmonics_of_the_unseen_sheets() -> None:
    """The camera is below the sheets: only their radiance along rays acts on the image."""
    found = gradients(lambda values: losses(values)[0], start(), LEARNT)
    assert (found["sh"][2:].abs().amax((1, 2)) > 0).all()
    assert torch.equal(found["albedo_logit"][2:], torch.zeros(2, 3, dtype=F64))
    assert torch.equal(found["roughness_logit"][2:], torch.zeros(2, dtype=F64))


@pytest.mark.parametrize("indirect", ["detached", "none"])
def test_detached_indirect_light_gives_the_harmonics_no_gradient(indirect: Indirect) -> None:
    kept = gradients(lambda values: losses(values, indirect)[0], start(), MOVED)
    assert kept.get("sh") is None or not kept["sh"].any()
    whole = gradients(lambda values: losses(values)[0], start(), MOVED)
    assert kept["albedo_logit"].any()
    if indirect == "detached":
        assert torch.equal(losses(start(), indirect)[0], losses(start())[0])
        assert torch.equal(kept["environment"], whole["environment"])
        assert not torch.equal(kept["centre"], whole["centre"]), "V keeps its gradient, L_ind has none"


def test_a_pixel_brighter_than_a_saturated_target_is_no_error() -> None:
    radiance = torch.tensor([[3.0, 0.5, 0.5]], dtype=F64, requires_grad=True)
    loss = pixel_loss(radiance, torch.ones(1, dtype=F64), torch.tensor([[1.0, 1.0, 0.2]], dtype=F64))
    loss.backward()
    assert radiance.grad is not None
    assert (radiance.grad[0].sign() == torch.tensor([0.0, -1.0, 1.0])).all()


def test_neutrality_is_the_mean_distance_of_visible_light_from_grey() -> None:
    """A light of (1.2, 1, 0.8) has distances 0.2, 0 and 0.2; under a veil of opacity 0.15, 85 % of that."""
    colours = torch.tensor([1.2, 1.0, 0.8], dtype=F64).expand(6, 12, 3)
    floor = sheet(0.0, dtype=F64)
    for surfels, share in ((floor, 1.0), (together(floor, sheet(9.0, DOWN, opacity=0.15, dtype=F64)), 0.85)):
        _, points = points_of(surfels)
        direction, weight = hemisphere_directions(points.normal, SAMPLES, None)
        incident = replace(RAYS, two_sided=False).incident(SurfelTracer(surfels), points, direction, weight, "none")
        assert float(neutrality(incident, colours)) == pytest.approx(share * 0.4 / 3, rel=1e-4)
