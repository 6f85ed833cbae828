"""Cases 1, 3 to 12 and 14: surfels without direction or extent, needles, giants, those seen edge-on, opacity at its
limits, many layers, and surfels at one depth (13 is ``test_poison``).
"""

import math

import pytest
import torch
from torch import Tensor

from hard_cases import ref64
from hard_cases.constructions import (
    FIELDS,
    assert_near,
    assert_same_bits,
    cast,
    doubled,
    drawn,
    facing,
    geometry_of,
    joined,
    looking_along_z,
    raw_surfels,
    rays_along_z,
    seen,
    with_radiance,
)
from hard_cases.ref64 import EPS
from radiogs_core.kernels.surfel.geometry import ALPHA_THRESHOLD, MAX_ALPHA
from radiogs_core.kernels.trace.bvh import SurfelBVH
from radiogs_core.kernels.trace.trace import trace
from radiogs_core.surfels.surfels import Surfels


def traced_along_z(surfels: Surfels) -> tuple[Tensor, ...]:
    rays = rays_along_z(20, 0.5)
    geometry = surfels.geometry()
    found = trace(
        SurfelBVH.build(geometry.detach()), geometry, surfels.sh, surfels.albedo,
        rays["origin"], rays["direction"], rays["t_min"],
    )  # fmt: skip
    return found.radiance, found.transmittance, found.features, found.depth


def assert_never_met(broken: Surfels) -> None:
    """Images and rays equal the scene's without ``broken``, to the last bit."""
    camera, sound = looking_along_z(), raw_surfels(8)
    assert float(seen(camera, sound)[1].max()) > 0.5
    assert_same_bits(seen(camera, joined(sound, broken)), seen(camera, sound))
    torch.manual_seed(1)
    expected = traced_along_z(sound)
    torch.manual_seed(1)
    assert_same_bits(traced_along_z(joined(sound, broken)), expected)


@pytest.mark.case(1)
def test_a_zero_quaternion_is_never_met() -> None:
    assert_never_met(Surfels.of(raw_surfels(2).parameters() | {"rotation": torch.zeros(2, 4)}))


@pytest.mark.case(1)
@pytest.mark.parametrize("length", [1e-38, 1e-20, 1e-8])
def test_a_tiny_quaternion_is_the_rotation_that_it_points_to(length: float) -> None:
    """Against Rodrigues' formula on the rounded numbers (below 1e-38 they have fewer digits, which are its own)."""
    surfels = raw_surfels(200)
    surfels.rotation = length * surfels.rotation
    exact = ref64.rotations(surfels.rotation)
    assert float((surfels.frame.double() - exact).abs().max()) < 4 * EPS


@pytest.mark.case(3)
@pytest.mark.parametrize("log_scale", [(-torch.inf, 0.0), (0.0, -torch.inf), (-torch.inf, -torch.inf), (-110.0, 0.0)])
def test_a_surfel_without_extent_is_never_met(log_scale: tuple[float, float]) -> None:
    broken = raw_surfels(1)
    broken.log_scale = torch.tensor([log_scale])
    assert_never_met(broken)


@pytest.mark.case(4)
@pytest.mark.parametrize("aspect", [1e2, 1e4, 1e6])
def test_a_needle_is_drawn_as_wide_as_a_pixel(aspect: float) -> None:
    """Its footprint bounds u and v by the pixel: an error of 4 eps z / s_pixel, 5e-5 of alpha at most here.

    A surfel thinner than 1/255 of a pixel adds nothing, because widening keeps its energy.
    """
    camera, surfels = looking_along_z(focal=900.0), raw_surfels(12, spread=0.004)
    surfels.log_scale = torch.tensor([1 / aspect, 1.0]).log().expand(12, 2).clone()
    surfels.opacity_logit = torch.full((12,), 4.0)
    expected = ref64.image(camera, ref64.splats(surfels, camera), ref64.colours(surfels, camera))[:3]
    assert (float(expected[1].max()) > 0.01) == (aspect < 1e6)
    assert_near(seen(camera, surfels), expected, 1e-4)


@pytest.mark.case(4)
@pytest.mark.parametrize("scale", [1e-2, 1e-4, 1e-5])
def test_a_ray_through_a_needle_errs_by_its_condition_number(scale: float) -> None:
    """u = (x - p) / s is off by 8 eps |p - o| / s, and alpha by at most o e^(-1/2) times that."""
    count, distance = 200, 3.0
    given = with_radiance(facing(torch.full((1,), distance), 0.9))
    turn = torch.tensor(0.7)
    given["axis_u"] = torch.stack([turn.cos(), turn.sin(), torch.tensor(0.0)])[None] / scale
    given["axis_v"] = torch.stack([turn.sin(), -turn.cos(), torch.tensor(0.0)])[None]
    given["centre"] = torch.tensor([[0.3, -0.2, distance]])
    # Rays through points of the needle's own bell, from the origin.
    across = scale * torch.randn(count, 1) * given["axis_u"] * scale + 0.5 * torch.randn(count, 1) * given["axis_v"]
    towards = given["centre"] + across
    length = towards.norm(dim=-1)
    rays = {"origin": torch.zeros(count, 3), "direction": towards / length[:, None], "t_min": torch.zeros(count)}
    found = cast(given, rays)[1]
    exact = ref64.cast(given, rays)[1]
    bound = 0.9 * math.exp(-0.5) * 8 * EPS * float(length.max()) / scale
    error = (found.double() - exact).abs()
    crossed = (found == 1) != (exact == 1)
    assert float(error[~crossed].max()) < bound
    assert float(error.max()) <= max(bound, 1.01 * ALPHA_THRESHOLD)
    assert float((exact < 0.9).double().mean()) > 0.5


@pytest.mark.case(5)
def test_a_huge_surfel_is_one_colour_with_finite_gradients() -> None:
    """Log-scale 20: nothing overflows, and every pixel is opacity times colour."""
    camera, surfels = looking_along_z(), raw_surfels(1, spread=0.0)
    surfels.rotation = torch.tensor([[0.1, 1.0, 0.1, 0.0]])
    surfels.log_scale = torch.full((1, 2), 20.0)
    leaves = {name: value.requires_grad_() for name, value in surfels.parameters().items()}
    features, alpha, _ = seen(camera, Surfels.of(leaves))
    colour = ref64.colours(Surfels.of({name: value.detach() for name, value in leaves.items()}), camera)[0]
    opacity = float(surfels.opacity.detach())
    expected = (opacity * colour).expand(camera.height, camera.width, 4)
    torch.testing.assert_close(features.detach().double(), expected, rtol=1e-5, atol=0)
    (features.sum() + alpha.sum()).backward()
    assert all(bool(torch.isfinite(leaf.grad).all()) for leaf in leaves.values() if leaf.grad is not None)
    assert float(traced_along_z(Surfels.of({n: v.detach() for n, v in leaves.items()}))[1].max()) == pytest.approx(
        1 - opacity, rel=1e-5
    )


def edge_on(cosine: float) -> dict[str, Tensor]:
    """One surfel that a ray along +x from the origin meets at t = 1.3 at that cosine; n.d is exact."""
    normal = torch.tensor([[-cosine, 0.0, math.sqrt(1 - cosine**2)]])
    return with_radiance(
        {
            "centre": torch.tensor([[1.0, 0.0, -0.3 * cosine]]),
            "axis_u": torch.tensor([[math.sqrt(1 - cosine**2), 0.0, cosine]]),
            "axis_v": torch.tensor([[0.0, 1.0, 0.0]]),
            "normal": normal,
            "opacity": torch.tensor([0.8]),
            "features": torch.rand(1, 4),
        }
    )


ALONG_X = {"origin": torch.zeros(1, 3), "direction": torch.tensor([[1.0, 0.0, 0.0]]), "t_min": torch.zeros(1)}


@pytest.mark.case(9)
@pytest.mark.parametrize("cosine", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_an_edge_on_surfel_is_met_where_float64_meets_it_with_finite_gradients(cosine: float) -> None:
    given = edge_on(cosine)
    leaves = {name: value.clone().requires_grad_() for name, value in given.items()}
    found = cast(leaves, ALONG_X)
    exact = ref64.cast(given, ALONG_X)
    assert float(exact[1]) < 0.5
    for ours, theirs in zip(found, exact, strict=True):
        error = (ours.detach().double() - theirs).abs() / theirs.abs().max()
        assert float(error.max()) < 16 * EPS / cosine
    torch.stack([value.sum() for value in found]).sum().backward()
    wide = {name: value.double().requires_grad_() for name, value in given.items()}
    torch.stack([value.sum() for value in cast(wide, doubled(ALONG_X))]).sum().backward()
    for name in given:
        ours, theirs = leaves[name].grad, wide[name].grad
        assert bool(torch.isfinite(ours).all()), name
        assert float((ours.double() - theirs).abs().max()) <= 64 * EPS / cosine * float(theirs.abs().max()), name


@pytest.mark.case(9)
@pytest.mark.parametrize("tilt", [0.0, -0.0, -1e-8])
def test_a_surfel_seen_exactly_edge_on_or_from_behind_is_not_met(tilt: float) -> None:
    given = {name: value.clone().requires_grad_() for name, value in edge_on(tilt).items()}
    found = cast(given, ALONG_X)
    assert float(found[1].detach()) == 1
    torch.stack([value.sum() for value in found]).sum().backward()
    assert all(value.grad is None or bool((value.grad == 0).all()) for value in given.values())


@pytest.mark.case(10)
@pytest.mark.parametrize("scale", [1e-3, 1e-2, 10.0, 1e3])
def test_facing_the_camera_does_not_depend_on_the_scenes_scale(scale: float) -> None:
    """Normals within 0.02 of edge-on; at most 0.1 % of the pixels may round to the other side."""
    camera = looking_along_z(30, 30, 30.0)
    count = 60
    given = facing(torch.full((count,), 3.0), 0.9)
    given["centre"] = given["centre"] + torch.randn(count, 3) * torch.tensor([0.5, 0.5, 0.3])
    towards = torch.nn.functional.normalize(given["centre"], dim=-1)
    side = torch.nn.functional.normalize(torch.linalg.cross(towards, torch.randn(count, 3)), dim=-1)
    normal = torch.nn.functional.normalize(side + 0.02 * torch.randn(count, 1) * towards, dim=-1)
    tangent = torch.linalg.cross(normal, side)
    tangent = torch.nn.functional.normalize(tangent, dim=-1)
    given |= {"normal": normal, "axis_u": tangent / 0.3, "axis_v": torch.linalg.cross(normal, tangent) / 0.3}
    larger = given | {
        "centre": scale * given["centre"], "axis_u": given["axis_u"] / scale, "axis_v": given["axis_v"] / scale,
    }  # fmt: skip
    here, there = drawn(camera, given)[1], drawn(camera, larger)[1]
    assert float((here > 0).double().mean()) > 0.1
    assert float(((here > 0) != (there > 0)).double().mean()) <= 1e-3
    assert float(((here - there).abs() > 1e-4).double().mean()) <= 1e-3


@pytest.mark.case(14)
@pytest.mark.parametrize("log_scale", [-30.0, -10.0, -3.0, 0.0, 10.0, 30.0, 40.0])
def test_extreme_but_valid_surfels_contribute_as_they_should(log_scale: float) -> None:
    """Colours of 1e4 and harmonics of 1e3 too. A log-scale of -10 is 1e-4 pixels wide and rightly adds nothing."""
    camera, surfels = looking_along_z(), raw_surfels(6, spread=0.3)
    surfels.log_scale = torch.full((6, 2), log_scale)
    surfels.sh = 1e3 * surfels.sh
    geometry = ref64.splats(surfels, camera)
    expected = ref64.image(camera, geometry, ref64.colours(surfels, camera))[:3]
    assert (float(expected[1].max()) > 0.1) == (log_scale >= -3)
    assert_near(seen(camera, surfels), expected, 1e-5, relative=True)
    given = surfels.geometry()
    bright = {"sh": surfels.sh, "features": 1e4 * torch.rand(6, 4)}
    rays = {
        "origin": torch.zeros(6, 3), "direction": torch.nn.functional.normalize(surfels.centre, dim=-1),
        "t_min": torch.zeros(6),
    }  # fmt: skip
    if log_scale < -3:
        return  # a ray towards the middle of a point misses it by rounding alone: case 4 has the bound
    fields = {name: getattr(given, name) for name in FIELDS}
    exact = ref64.traced(ref64.splats(surfels), bright | rays)
    assert float(exact[1].min()) < 0.9
    assert_near(cast(fields | bright, rays), exact, 1e-5, relative=True)
    assert geometry_of(fields).centre is given.centre


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
    """More equal depths than a buffer holds. Equal surfels may be exchanged; different ones are ordered by index."""
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
