"""H1 to H13: the released formula fails a bound that ours passes. The formulas are in ``released``."""

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases import ref64, released
from hard_cases.constructions import (
    cast,
    facing,
    geometry_of,
    looking_along_z,
    moved,
    raw_surfels,
    rays_along_z,
    unit,
    with_radiance,
)
from hard_cases.constructions import seen as seen_by
from hard_cases.ref64 import EPS
from radiogs_bench.scoring.metrics.values import Value, mean
from radiogs_core.kernels.shade.brdf import ggx_distribution, specular
from radiogs_core.kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from radiogs_core.kernels.surfel.support import support_of
from radiogs_core.kernels.trace.trace import Hits
from radiogs_core.transport.sampling import hemisphere_directions, tangent_frame
from radiogs_core.transport.splatting import splat
from radiogs_core.transport.splitsum import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.tracer import visibility_of

F64 = torch.float64
UP = torch.tensor([0.0, 0.0, 1.0])


def tilted(angle: Tensor) -> tuple[Tensor, Tensor]:
    """Half-vectors at these angles from +z in float32, and the angles that they have after rounding."""
    half = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1).float()
    return half, torch.atan2(half[:, 0].double(), half[:, 2].double())


@pytest.mark.case(25)
@pytest.mark.parametrize(
    ("roughness", "peak"), [(0.02, 8e-8), (0.05, 1.2e-4), (0.09, 0.0135), (0.10, 0.031), (0.15, 0.805), (0.20, 1.0)]
)
def test_h1_a_clamped_denominator_flattens_the_highlight(roughness: float, peak: float) -> None:
    """``peak`` is the measured ratio of the released highlight to the truth."""
    truth = float(ref64.ggx(torch.zeros(1), roughness))
    theirs = float(released.ggx_distribution(torch.ones(1, dtype=F64), roughness))
    assert theirs / truth == pytest.approx(peak, rel=0.05)
    assert roughness == 0.20 or abs(theirs / truth - 1) > 1e-5
    ours = float(ggx_distribution(UP[None], UP[None], torch.full((1,), roughness)))
    assert ours == pytest.approx(float(ref64.ggx(torch.zeros(1), float(torch.tensor(roughness)))), rel=1e-5)


@pytest.mark.case(25)
@pytest.mark.parametrize(("roughness", "loss"), [(0.02, 0.1), (0.05, 5e-3), (0.10, 3e-4), (0.20, 2e-5)])
def test_h2_the_textbooks_denominator_cancels_near_the_peak(roughness: float, loss: float) -> None:
    half, angle = tilted(torch.linspace(0, 0.01, 4001, dtype=F64))
    exact = ref64.ggx(angle, float(torch.tensor(roughness)))
    theirs = released.ggx_without_clamp(half[:, 2], float(torch.tensor(roughness))).double()
    assert float(((theirs - exact).abs() / exact).max()) > loss
    ours = ggx_distribution(half, UP.expand(4001, 3), torch.full((4001,), roughness)).double()
    assert float(((ours - exact).abs() / exact).max()) < 1e-6


@pytest.mark.case(28)
@pytest.mark.parametrize(("samples", "gain"), [(16, 1.061), (64, 1.038), (128, 1.034), (256, 1.032), (1024, 1.031)])
def test_h3_a_floor_under_the_samples_brightens_the_furnace(samples: int, gain: float) -> None:
    assert float(2 * released.hemisphere_heights(samples).mean()) == pytest.approx(gain, abs=1e-3)
    direction, weight = hemisphere_directions(UP[None], samples, None)
    assert float((weight * direction[..., 2]).sum() / math.pi) == pytest.approx(1, abs=1e-3)


@pytest.mark.case(30)
def test_h4_the_mirrored_direction_leaves_the_surface() -> None:
    """Seen in a light of which only the mirrored texel shines: the released direction looks into the ground."""
    normal = unit(200)
    outgoing = normalize(normal + 0.9 * unit(200), dim=-1)
    into = released.mirrored(normal, outgoing)
    assert bool(((into * normal).sum(-1) < 0).all())
    up = UP.double()[None]
    view = normalize(torch.tensor([[0.6, 0.0, 0.8]], dtype=F64), dim=-1)
    sky = torch.zeros(16, 32, 3, dtype=F64)
    sky[:8, 12:20] = 0  # +X, where the view is
    sky[:8, :4] = sky[:8, 28:] = 1  # -X, above the horizon, where the mirror image is
    rough, white = torch.full((1,), 0.05, dtype=F64), torch.ones(1, 3, dtype=F64)
    ours = split_sum_radiance(up, white, rough, view, PrefilteredLight(sky))[1]
    ground = torch.zeros(16, 32, 3, dtype=F64)
    ground[8:] = 1
    below = split_sum_radiance(up, white, rough, view, PrefilteredLight(ground))[1]
    assert float(ours.min()) > 0.03  # F0 of the light that is there
    assert float(below.max()) < 1e-3
    assert float(released.mirrored(up, view)[0, 2]) < 0


@pytest.mark.case(32)
@pytest.mark.parametrize(("tilt", "off"), [(0.1, 5e-6), (0.01, 3e-4), (1e-3, 0.05), (3e-4, 0.5)])
def test_h5_the_minimal_rotation_is_no_rotation_near_the_south_pole(tilt: float, off: float) -> None:
    azimuth = torch.linspace(0, 2 * math.pi, 400, dtype=F64)
    angle = torch.full_like(azimuth, math.pi - tilt)
    normal = torch.stack([angle.sin() * azimuth.cos(), angle.sin() * azimuth.sin(), angle.cos()], -1).float()

    def error(frame: Tensor) -> float:
        return float((frame.double().mT @ frame.double() - torch.eye(3, dtype=F64)).abs().max())

    assert error(released.minimal_rotation(normal)) > off > 4 * EPS
    assert error(tangent_frame(normal)) < 4 * EPS


@pytest.mark.case(9)
@pytest.mark.parametrize("cosine", [1e-4, 2e-5])
def test_h6_a_clamped_distance_and_its_unclamped_gradient_disagree_at_grazing(cosine: float) -> None:
    normal = torch.tensor([[-cosine, 0.0, math.sqrt(1 - cosine**2)]])
    towards = torch.tensor([[1.0, 0.0, -0.3 * cosine]])
    direction = torch.tensor([[1.0, 0.0, 0.0]])
    exact = float((normal.double() * towards.double()).sum() / normal[0, 0].double())
    theirs = float(released.hit_distance(normal, towards, direction))
    assert abs(theirs / exact - 1) > 0.5 > 16 * EPS / cosine
    # Its own derivative is n.d / 1e-6 there: the backward pass is off by the square of what was clamped.
    own = -cosine / 1e-6
    assert abs(float(released.hit_distance_slope(normal, direction)) / own) > 50
    given = with_radiance({
        "centre": towards, "normal": normal, "axis_v": torch.tensor([[0.0, 1.0, 0.0]]),
        "axis_u": torch.tensor([[math.sqrt(1 - cosine**2), 0.0, cosine]]), "opacity": torch.tensor([0.8]),
        "features": torch.ones(1, 4),
    })  # fmt: skip
    given["centre"] = towards.clone().requires_grad_()
    ray = {"origin": torch.zeros(1, 3), "direction": direction, "t_min": torch.zeros(1)}
    _, transmittance, _, depth = cast(given, ray)
    met = depth / (1 - transmittance)
    assert float(met.detach()) == pytest.approx(exact, rel=16 * EPS / cosine)
    met.sum().backward()
    # The distance alone: d t / d p along the normal is n_z / (n.d).
    assert float(given["centre"].grad[0, 2]) == pytest.approx(
        float(normal[0, 2] / normal[0, 0]), rel=64 * EPS / cosine + 1e-3
    )


@pytest.mark.case(11)
def test_h7_both_passes_see_the_same_hits() -> None:
    """A surfel between the released passes' two starts, and more ties than a buffer holds."""
    between = 0.5 * (released.FORWARD_T_MIN + released.BACKWARD_T_MIN)
    theirs = [between > start for start in (released.FORWARD_T_MIN, released.BACKWARD_T_MIN)]
    assert theirs == [False, True]
    for start, met in ((released.BACKWARD_T_MIN, True), (released.FORWARD_T_MIN, False)):
        given = with_radiance(facing(torch.tensor([between, 2.0]), 0.5), 1)
        given["opacity"] = given["opacity"].clone().requires_grad_()
        found = cast(given, rays_along_z() | {"t_min": torch.tensor([start])})[1]
        assert float(found.detach()) == pytest.approx(0.25 if met else 0.5, rel=1e-5)
        found.sum().backward()
        assert (float(given["opacity"].grad[0]) != 0) == met
    ties = with_radiance(facing(torch.full((70,), 2.0), 0.02), 1)
    ties["opacity"] = ties["opacity"].clone().requires_grad_()
    transmittance = cast(ties, rays_along_z(), 1e-6)[1]
    transmittance.sum().backward()
    assert float(transmittance.detach()) == pytest.approx(0.98**70, rel=1e-5)
    slopes = ties["opacity"].grad
    torch.testing.assert_close(slopes, torch.full((70,), -(0.98**69)), rtol=1e-4, atol=0)


@pytest.mark.case(6)
@pytest.mark.parametrize("opacity", [0.0, 1e-8, 1e-3, 1 / 256])
def test_h8_a_faint_surfel_has_no_nan_bounds(opacity: float) -> None:
    faint = torch.tensor([opacity])
    assert not bool(torch.isfinite(released.support_radius(faint)).all())
    support = support_of(geometry_of(facing(torch.tensor([2.0]), opacity)))
    assert float(support.radius) == 0
    assert bool((support.extent == 0).all())
    assert not bool(support.can_be_hit.any())


@pytest.mark.case(19)
def test_h9_no_surfel_comes_or_goes_when_the_world_is_scaled() -> None:
    surfels, camera = raw_surfels(60), looking_along_z()
    normal = surfels.frame[..., 2]
    kept = {scale: released.takes_part(scale * surfels.centre, normal) for scale in (1e-3, 1.0)}
    assert int((kept[1e-3] != kept[1.0]).sum()) > 30
    here, there = seen_by(camera, surfels), seen_by(*reversed(moved(surfels, camera, factor=1e-3)))
    assert float((here[0] - there[0]).abs().max()) < 1e-4
    assert float(here[1].max()) > 0.5


@pytest.mark.case(39)
def test_h10_an_empty_pixel_has_a_gradient_of_zero_and_not_nan() -> None:
    blended, alpha = torch.zeros(1, requires_grad=True), torch.zeros(1, requires_grad=True)
    depth = released.expected_depth(blended, alpha)
    assert float(depth.detach()) == 0
    depth.sum().backward()
    assert bool(torch.isnan(blended.grad).any() or torch.isnan(alpha.grad).any())
    surfels, camera = raw_surfels(2, spread=0.1), looking_along_z(12, 8)
    surfels.centre = (surfels.centre - torch.tensor([2.0, 0.0, 0.0])).requires_grad_()
    found = splat(camera, surfels, {"albedo": surfels.albedo}, 1.0)
    assert bool((found.alpha == 0).any())
    found.depth.sum().backward()
    assert bool(torch.isfinite(surfels.centre.grad).all())


def through(opacity: float, count: int = 2) -> Hits:
    """The hits of a ray that passes through two equal surfels of white radiance."""
    given = with_radiance(facing(torch.linspace(2, 3, count), opacity), 1)
    given["sh"] = torch.zeros_like(given["sh"])
    radiance, transmittance, features, depth = cast(given, rays_along_z())
    return Hits(radiance, transmittance, features, depth)


@pytest.mark.case(36)
def test_h11_the_stop_at_three_percent_has_a_bounded_step_and_no_nan() -> None:
    """The rule is the paper's and so is its step, of 3 % in V; colours stay whole, and empty rays have gradients."""
    colour, alpha = torch.zeros(1, 3, requires_grad=True), torch.zeros(1, requires_grad=True)
    torch.cat([value.flatten() for value in released.saturated(colour, alpha)]).sum().backward()
    assert not bool(torch.isfinite(colour.grad).all() and torch.isfinite(alpha.grad).all())
    left = torch.ones(1, requires_grad=True)
    visibility, whole = visibility_of(Hits(torch.zeros(1, 3), left, torch.zeros(1, 0), torch.zeros(1)))
    (visibility + whole).sum().backward()
    assert bool(torch.isfinite(left.grad).all())
    # Either side of the stop: T = (1 - o)^2 crosses 3 % at o = 0.8268.
    edge = 1 - math.sqrt(TRACE_TRANSMITTANCE_STOP)
    before, after = through(edge - 1e-4), through(edge + 1e-4)
    seen = [float(visibility_of(found)[0]) for found in (before, after)]
    assert seen[1] == 0
    assert 0 < seen[0] - seen[1] <= TRACE_TRANSMITTANCE_STOP + 1e-3
    radiance = [float((found.radiance[0, 0] * visibility_of(found)[1]).sum()) for found in (before, after)]
    assert radiance[1] == pytest.approx(0.5, rel=1e-5)
    assert radiance[0] == pytest.approx(0.5 * (1 - seen[0]), rel=1e-5)


@pytest.mark.case(36)
@pytest.mark.parametrize("opacity", [0.3, 0.7, 0.9])
def test_h11_away_from_the_stop_visibility_has_the_derivative_of_its_differences(opacity: float) -> None:
    given = with_radiance(facing(torch.linspace(2, 3, 2, dtype=F64), opacity), 1)
    given["opacity"] = given["opacity"].clone().requires_grad_()
    rays = rays_along_z(dtype=F64)

    def visible(values: Tensor) -> Tensor:
        found = cast(given | {"opacity": values}, rays)
        return visibility_of(Hits(found[0], found[1], found[2], found[3]))[0].sum()

    visible(given["opacity"]).backward()
    step = 1e-6 * torch.tensor([1.0, 0.0], dtype=F64)
    with torch.no_grad():
        numeric = float(visible(given["opacity"] + step) - visible(given["opacity"] - step)) / 2e-6
    assert float(given["opacity"].grad[0]) == pytest.approx(numeric, rel=1e-6, abs=1e-9)


@pytest.mark.case(47)
def test_h12_a_mean_is_over_the_frames_that_are_in_it() -> None:
    scores = [30.0, 32.0, 34.0, 36.0]
    assert released.mean_psnr(scores, 2) == pytest.approx(17.5)
    assert mean([Value(score) for score in scores[2:]]).value == pytest.approx(35)


@pytest.mark.case(26)
def test_h13_a_grazing_view_keeps_its_gradient() -> None:
    """n.v = 0 exactly, and 1e-8: the released normal becomes zero, and its clamp stops every pull."""
    normal = UP[None].clone().requires_grad_()
    for height in (0.0, 1e-8):
        view = torch.tensor([[1.0, 0.0, height]])
        cosine = released.facing_cosine(normal, view)
        (pull,) = torch.autograd.grad(cosine.sum(), normal)
        assert bool((pull == 0).all())
    view, light = torch.tensor([[1.0, 0.0, 1e-8]]), normalize(torch.tensor([[-1.0, 0.3, 0.1]]), dim=-1)
    value = specular(normal, view, light, torch.tensor([0.5]))
    (pull,) = torch.autograd.grad(value.sum(), normal)
    assert float(value.detach()) > 0
    assert bool(torch.isfinite(pull).all())
    assert float(pull.abs().max()) > 1e-3
    exact = specular(normal.detach().double(), view.double(), light.double(), torch.tensor([0.5], dtype=F64))
    assert float(value.detach()) == pytest.approx(float(exact), rel=1e-4)
