"""A whole frame in float64 against loops over the formulas, and gradients of each loss against differences."""

from functools import cache

import pytest
import torch
from torch import Tensor

from baselines.methods.dense import F64, assert_same_gradients, floor, gradients, surfels_of
from baselines.methods.gi_gs import dense
from baselines.methods.gi_gs.world import buffer_of, march
from baselines.methods.irgs.world import looking_down, sheet, together
from radiogs_baselines.methods.gi_gs.gbuffer import GBuffer
from radiogs_baselines.methods.gi_gs.marching import GATHERED, NO_HIT
from radiogs_baselines.methods.gi_gs.shading import Shader, bounce, median, openness, summed, weighted
from radiogs_baselines.methods.gi_gs.training import image_loss, plainness, variation
from radiogs_core.learning.losses import environment_smoothness
from radiogs_core.on_surfels.split_sum_light import SplitSumLight
from radiogs_core.transport.prefiltered_light import PrefilteredLight
from reference.differences import Values, assert_gradients

SIZE = 7
CAMERA = looking_down(1.5, size=SIZE, dtype=F64)
MARCHES = march((0.3, 0.5, 0.7), bias=0.05, thick=0.6)
MATERIALS = ("albedo_logit", "roughness_logit", "metallic_logit")
LEARNT = (*MATERIALS, "environment")
MOVED = (*LEARNT, "centre", "opacity_logit", "log_scale", "rotation")


@cache
def start() -> Values:
    """A floor of two overlapping surfels, and two raised, adjacent surfels that occlude it and send it a bounce."""
    torch.manual_seed(3)
    high = [sheet(0.3, (0.2, 0.1, 0.97), 0.15, 0.97, 0.8, 0.3, dtype=F64), sheet(0.4, scale=0.1, dtype=F64)]
    given = together(*floor(0.95), *high).parameters()
    given["albedo_logit"] = given["albedo_logit"] + 0.3 * torch.randn_like(given["albedo_logit"])
    given["centre"] = given["centre"] + 0.05 * torch.randn_like(given["centre"])
    given["centre"][2:] += torch.tensor([[0.25, 0.1, 0.0], [-0.3, -0.2, 0.0]], dtype=F64)
    given["rotation"] = given["rotation"] / given["rotation"].norm(dim=-1, keepdim=True)
    return given | {
        "metallic_logit": torch.tensor([-2.0, -1.0, 0.5, -0.5], dtype=F64),
        "environment": 0.2 + 0.6 * torch.rand(6, 12, 3, dtype=F64),
    }


@cache
def target() -> Tensor:
    torch.manual_seed(5)
    return torch.rand(SIZE, SIZE, 3, dtype=F64)


def found_image(values: Values) -> Tensor:
    buffer, alpha = buffer_of(CAMERA, surfels_of(values), values["metallic_logit"])
    how = Shader(MARCHES, True, True, "display", True)
    return how.shade(buffer, alpha, SplitSumLight(PrefilteredLight(values["environment"])))["image"]


@cache
def dense_hits() -> list[list[int | None]]:
    surfels, metallic = surfels_of(start()), start()["metallic_logit"].sigmoid()
    straight, alpha, depth = dense.materials(CAMERA, surfels, metallic)
    normal = straight[:, :3] / straight[:, :3].norm(dim=-1, keepdim=True)
    return dense.pixels_hit(CAMERA, MARCHES, alpha, depth, normal)


def dense_image(values: Values) -> Tensor:
    metallic = values["metallic_logit"].sigmoid()
    flat = dense.image(CAMERA, MARCHES, surfels_of(values), metallic, values["environment"], dense_hits())
    return flat.view(SIZE, SIZE, 3)


def test_every_direction_hits_the_same_pixel_as_the_loops() -> None:
    buffer, _ = buffer_of(CAMERA, surfels_of(start()))
    assert len(buffer) == SIZE * SIZE
    hits = MARCHES.hit_pixels(buffer).view(SIZE * SIZE, dense.HEIGHTS - 2, dense.AZIMUTHS).mT
    expected = torch.tensor([[NO_HIT if hit is None else hit for hit in hits] for hits in dense_hits()])
    expected = expected.view(SIZE * SIZE, dense.AZIMUTHS, dense.HEIGHTS)[:, :, 1:-1]
    assert torch.equal(hits.long(), expected)
    share = float((hits != NO_HIT).double().mean())
    assert 0.02 < share < 0.9, "some directions hit a surface, and some do not"
    assert len(hits.unique()) > 5


def test_a_frame_and_its_gradients_equal_the_formulas() -> None:
    """Includes the gradients to geometry from the blending of the maps."""
    found, expected = found_image(start()), dense_image(start())
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-12)
    ours, theirs = (
        gradients(lambda values, image=image: image_loss(image(values), target()), start(), MOVED)
        for image in (found_image, dense_image)
    )
    assert_same_gradients(ours, theirs, MOVED)


def test_the_bounce_has_gradient_only_to_the_albedo() -> None:
    values = {name: value.clone().requires_grad_() for name, value in start().items()}
    buffer, alpha = buffer_of(CAMERA, surfels_of(values), values["metallic_logit"])
    light = SplitSumLight(PrefilteredLight(values["environment"]))
    maps = Shader(MARCHES, True, True, "display", True).shade(buffer, alpha.detach(), light)
    assert float(maps["indirect"].detach().max()) > 0
    straight = torch.autograd.grad(
        maps["indirect"].sum(), [buffer.albedo, buffer.roughness, buffer.metallic, values["environment"]],
        allow_unused=True, retain_graph=True,
    )  # fmt: skip
    assert straight[0].abs().max() > 0
    assert straight[1:] == (None, None, None)
    hits, grid = MARCHES.hit_pixels(buffer), MARCHES.grid
    ones = GATHERED * weighted(hits, torch.ones(SIZE, SIZE, 3, dtype=F64), grid.cosine_weight)
    sent = bounce(buffer, ones)
    (slope,) = torch.autograd.grad(sent.sum(), buffer.albedo, retain_graph=True)
    torch.testing.assert_close(slope * buffer.albedo, sent, rtol=1e-12, atol=0)


def direct_light(buffer: GBuffer, values: Values, open_share: Tensor) -> Tensor:
    light = SplitSumLight(PrefilteredLight(values["environment"]))
    surface = (buffer.normal, buffer.outgoing, buffer.albedo, buffer.roughness, buffer.metallic)
    return light.reflected(*surface).occluded(open_share)


@cache
def fixed() -> tuple[Tensor, Tensor]:
    """Openness of each point of the start, and the factor of its albedo in its bounce; both have no gradient."""
    buffer, _ = buffer_of(CAMERA, surfels_of(start()), start()["metallic_logit"])
    hits, grid = MARCHES.hit_pixels(buffer), MARCHES.grid
    open_share = openness(hits, grid)
    direct = direct_light(buffer, start(), open_share)
    arriving = weighted(hits, buffer.image(direct).clamp(0, 1), grid.cosine_weight)
    sent = bounce(buffer, GATHERED * arriving)
    return open_share, sent / buffer.albedo


def image_with_fixed_parts(values: Values) -> Tensor:
    """The image with all parts without gradient fixed to their values at the start."""
    open_share, of_albedo = fixed()
    buffer, alpha = buffer_of(CAMERA, surfels_of(values), values["metallic_logit"])
    direct = direct_light(buffer, values, open_share)
    indirect = median(buffer.image(of_albedo * buffer.albedo))
    return summed(buffer.image(direct) * alpha[..., None], indirect * alpha[..., None], alpha, "display", True)


def branches(values: Values) -> list[bool]:
    """The branch of every kink of the image loss: signs of errors, cells of tables, and indices of medians."""
    buffer, _ = buffer_of(CAMERA, surfels_of(values), values["metallic_logit"])
    bounced = buffer.image(fixed()[1] * buffer.albedo)
    flags = torch.cat([
        (image_with_fixed_parts(values) > target()).flatten(),
        *((buffer.roughness * cells).floor().flatten().double() for cells in (5, 31)),
        (bounced == median(bounced)).flatten(),
    ])  # fmt: skip
    return flags.tolist()


def test_gradients_of_the_image_loss_equal_central_differences() -> None:
    ours = gradients(lambda values: image_loss(found_image(values), target()), start(), LEARNT)
    assert_gradients(
        lambda values: float(image_loss(image_with_fixed_parts(values), target())),
        start(),
        ours,
        1e-4,
        branches,
        directions=4,
    )


def stacked(values: Values) -> Tensor:
    buffer, _ = buffer_of(CAMERA, surfels_of(values), values["metallic_logit"])
    maps = torch.cat([buffer.albedo, buffer.roughness[:, None], buffer.metallic[:, None]], -1)
    solid = torch.isfinite(buffer.depth)
    return variation(buffer.image(maps), target(), solid)


def plain(values: Values) -> Tensor:
    return plainness(buffer_of(CAMERA, surfels_of(values), values["metallic_logit"])[0], True)


@pytest.mark.parametrize(
    ("loss", "names"),
    [
        (stacked, MATERIALS),
        (plain, ("roughness_logit", "metallic_logit")),
        (lambda values: environment_smoothness(values["environment"]), ("environment",)),
    ],
    ids=["variation", "plainness", "light smoothness"],
)
def test_gradients_of_the_other_losses_equal_central_differences(loss: object, names: tuple[str, ...]) -> None:
    ours = gradients(loss, start(), names)
    assert set(ours) == set(names)
    assert_gradients(lambda values: float(loss(values)), start(), ours, 1e-3, directions=4)  # type: ignore[operator]


def test_variation_compares_solid_neighbours_weighted_by_the_image() -> None:
    """Two pixels differ by 0.3 across, where the image differs by 0.6; the third pixel is not solid."""
    maps = torch.tensor([[[0.1], [0.4], [5.0]]], dtype=F64)
    shown = torch.tensor([0.0, 0.6, 0.0], dtype=F64)[None, :, None].expand(1, 3, 3)
    solid = torch.tensor([[True, True, False]])
    expected = 0.3**2 * torch.exp(torch.tensor(-0.6, dtype=F64)) / 2
    torch.testing.assert_close(variation(maps, shown, solid), expected)
    torch.testing.assert_close(variation(maps.transpose(0, 1), shown.transpose(0, 1), solid.T), expected)


def test_plainness_is_the_distance_from_a_rough_dielectric() -> None:
    buffer, _ = buffer_of(CAMERA, surfels_of(start()), torch.full((4,), 0.25, dtype=F64).logit())
    rough = float((1 - buffer.roughness).mean())
    assert float(plainness(buffer, True)) == pytest.approx(rough + 0.25)
    assert float(plainness(buffer, False)) == pytest.approx(rough)


def test_an_image_brighter_than_a_saturated_target_is_no_error() -> None:
    image = torch.tensor([[[3.0, 0.5, 0.5]]], dtype=F64, requires_grad=True)
    image_loss(image, torch.tensor([[[1.0, 1.0, 0.2]]], dtype=F64)).backward()
    assert image.grad is not None
    assert (image.grad[0, 0].sign() == torch.tensor([0.0, -1.0, 1.0])).all()
