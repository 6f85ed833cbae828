"""Cases 6 to 8, 11 and 12: opacity at its limits, many layers, and surfels at one depth (13 is ``test_poison``)."""

import pytest
import torch
from torch import Tensor

from hard_cases import ref64
from hard_cases.constructions import (
    assert_near,
    assert_same_bits,
    cast,
    doubled,
    drawn,
    facing,
    looking_along_z,
    raw_surfels,
    rays_along_z,
    seen,
    with_radiance,
)
from hard_cases.ref64 import EPS
from radiogs_core.kernels.surfel.geometry import ALPHA_THRESHOLD, MAX_ALPHA

THRESHOLD = torch.tensor(ALPHA_THRESHOLD)


@pytest.mark.case(6)
@pytest.mark.parametrize(
    "opacity",
    [
        0.0, 1e-8, float(torch.nextafter(THRESHOLD, torch.tensor(0.0))), float(THRESHOLD),
        float(torch.nextafter(THRESHOLD, torch.tensor(1.0))), 0.01 - EPS, 0.01 + EPS, 1 - EPS, 1.0,
    ],
)  # fmt: skip
def test_opacity_at_its_limits_is_as_exact_as_elsewhere(opacity: float) -> None:
    """Nothing below 1/255, not even where the square root of a logarithm would be NaN; and nothing above 0.99."""
    camera = looking_along_z(9, 7)  # an odd number of pixels: one looks along the axis, where the bell is 1
    given = with_radiance(facing(torch.tensor([2.0, 3.0]), torch.tensor([opacity, 0.6])))
    assert_near(drawn(camera, given)[:3], ref64.image(camera, given, given["features"])[:3], 1e-6)
    rays = rays_along_z(1)
    found = cast(given, rays)
    assert_near(found, ref64.cast(given, rays), 2e-6)
    if opacity < ALPHA_THRESHOLD:
        without = {name: value[1:] for name, value in given.items()}
        assert_same_bits(drawn(camera, given), drawn(camera, without))
        assert_same_bits(found, cast(without, rays))


@pytest.mark.case(6)
@pytest.mark.parametrize("logit", [-40.0, 40.0, -1e4, 1e4])
def test_saturated_opacities_have_finite_gradients(logit: float) -> None:
    surfels = raw_surfels(10)
    surfels.opacity_logit = torch.full((10,), logit, requires_grad=True)
    features, alpha, _ = seen(looking_along_z(), surfels)
    (features.sum() + alpha.sum()).backward()
    assert bool(torch.isfinite(surfels.opacity_logit.grad).all())
    assert bool((alpha > 0.5).any()) == (logit > 0)


@pytest.mark.case(7)
@pytest.mark.parametrize("count", [3, 10, 100])
def test_a_stack_of_opaque_surfels_has_bounded_exact_gradients(count: int) -> None:
    """1 / (1 - alpha) is at most 100 for each; the gradient's bound is 1e2 / (1 - MAX_ALPHA) for values of one."""
    camera = looking_along_z(5, 3)
    given = facing(torch.linspace(2, 4, count), 1.0, scale=0.6)

    def gradients(draw: object, values: dict[str, Tensor]) -> dict[str, Tensor]:
        leaves = {name: value.clone().requires_grad_() for name, value in values.items()}
        features, alpha, *_ = draw(leaves)  # type: ignore[operator]
        (features.square().sum() + alpha.sum()).backward()
        return {name: leaf.grad for name, leaf in leaves.items()}  # type: ignore[misc]

    ours = gradients(lambda leaves: drawn(camera, leaves), given)
    exact = gradients(lambda leaves: ref64.image(camera, leaves, leaves["features"]), doubled(given))
    for name, gradient in exact.items():
        assert bool(torch.isfinite(ours[name]).all())
        assert float(ours[name].abs().max()) < 1e2 / (1 - MAX_ALPHA)
        assert float((ours[name].double() - gradient).abs().max()) <= 1e-3 * float(gradient.abs().max()) + 1e-6, name


LAYERS = 30_000


@pytest.mark.case(8)
def test_thirty_thousand_layers_below_the_threshold_are_air() -> None:
    """Alpha in [0, 0.001] is below 1/255: by the documented cut-off nothing is met, exactly."""
    given = with_radiance(facing(torch.linspace(1, 3, LAYERS), 1e-3 * torch.rand(LAYERS)), 1)
    assert float(cast(given, rays_along_z())[1]) == 1
    assert float(drawn(looking_along_z(1, 1), given)[1]) == 0


@pytest.mark.case(8)
@pytest.mark.parametrize(("low", "high"), [(1 / 250, 1 / 200), (1 / 250, 0.5)])
def test_transmittance_through_thirty_thousand_layers_is_the_sum_of_logarithms(low: float, high: float) -> None:
    """Without a stop: the product falls to 1e-59, below float32's range, and its gradient stays finite."""
    alpha = low + (high - low) * torch.rand(LAYERS)
    given = with_radiance(facing(torch.linspace(1, 3, LAYERS), alpha), 1)
    given["sh"] = torch.zeros_like(given["sh"]).requires_grad_()
    given["opacity"] = given["opacity"].clone().requires_grad_()
    radiance, transmittance, _, _ = cast(given, rays_along_z(), stop=0.0)
    exact = float(torch.log1p(-alpha.double()).sum().exp())
    assert float(transmittance.detach()) == pytest.approx(exact, rel=1e-5, abs=1e-7)
    assert radiance.detach()[0].tolist() == pytest.approx([0.5 * (1 - exact)] * 3, rel=2e-5)
    (radiance.sum() + transmittance.sum()).backward()
    assert all(bool(torch.isfinite(given[name].grad).all()) for name in ("sh", "opacity"))


@pytest.mark.case(8)
def test_a_pixel_through_thirty_thousand_layers_stops_where_float64_does() -> None:
    alpha = 1 / 250 + 1e-3 * torch.rand(LAYERS)
    given = facing(torch.linspace(1, 3, LAYERS), alpha)
    left = torch.cumprod(1 - alpha.double(), 0)
    kept = int((left >= 1e-4).sum())
    expected = 1 - float(left[kept - 1])
    assert 1000 < kept < LAYERS
    assert float(drawn(looking_along_z(1, 1), given)[1]) == pytest.approx(expected, rel=1e-5)


@pytest.mark.case(11)
@pytest.mark.parametrize("copies", [17, 33, 64])
def test_coincident_surfels_are_all_blended_whatever_their_order(copies: int) -> None:
    """More equal depths than a buffer holds. Equal surfels may be exchanged; different ones go by their number."""
    camera = looking_along_z(3, 3)
    given = with_radiance(facing(torch.full((copies,), 2.0), 0.03))
    assert_near(drawn(camera, given)[:3], ref64.image(camera, given, given["features"])[:3], 1e-6)
    rays = rays_along_z(5, 0.3)
    assert_near(cast(given, rays, 1e-6), ref64.cast(given, rays, 1e-6), 1e-6)
    alike = given | {"features": given["features"][:1].expand(copies, 4), "sh": given["sh"][:1].expand(copies, 16, 3)}
    shuffle = torch.randperm(copies)
    shuffled = {name: value[shuffle].contiguous() for name, value in alike.items()}
    assert_near(cast(shuffled, rays, 1e-6), cast(alike, rays, 1e-6), 1e-6)
    assert_near(drawn(camera, shuffled), drawn(camera, alike), 1e-6)


@pytest.mark.case(12)
@pytest.mark.parametrize("ulps", [1, 2, 4])
@pytest.mark.parametrize("swapped", [False, True])
def test_surfels_a_few_ulps_apart_are_blended_in_their_rounded_order(ulps: int, swapped: bool) -> None:
    near = torch.tensor(3.0)
    far = near
    for _ in range(ulps):
        far = torch.nextafter(far, torch.tensor(4.0))
    given = with_radiance(facing(torch.stack([far, near] if swapped else [near, far]), 0.7))
    camera, rays = looking_along_z(3, 3), rays_along_z(1)
    assert_near(drawn(camera, given)[:3], ref64.image(camera, given, given["features"])[:3], 1e-6)
    expected = ref64.cast(given, rays)
    assert_near(cast(given, rays), expected, 2e-6)
    front = given["features"][1 if swapped else 0]
    assert float((expected[2][0] - 0.7 * front.double()).abs().max()) > 1e-3, "the second should show through"
