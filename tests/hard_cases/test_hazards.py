"""Hazards of the released formulas: each fails a bound that ours passes. Cases of the catalogue hold the others."""

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from hard_cases.constructions import cast, facing, rays_along_z, unit, with_radiance
from radiogs_core.kernels.shade.brdf import specular
from radiogs_core.kernels.surfel.geometry import TRACE_TRANSMITTANCE_STOP
from radiogs_core.kernels.trace.trace import Hits
from radiogs_core.transport.prefiltered_light import PrefilteredLight, split_sum_radiance
from radiogs_core.transport.tracer import visibility_of

F64 = torch.float64
UP = torch.tensor([0.0, 0.0, 1.0])

FORWARD_T_MIN = torch.finfo(torch.float32).eps
"""H7: where the released forward pass begins to look for hits."""

BACKWARD_T_MIN = 0.0
"""H7: where the backward pass does, on the same ray."""


def mirrored(normal: Tensor, outgoing: Tensor) -> Tensor:
    """H4: v - 2 (n.v) n, though v points to the camera."""
    return outgoing - 2 * (normal * outgoing).sum(-1, keepdim=True) * normal


def saturated(colour: Tensor, alpha: Tensor) -> tuple[Tensor, Tensor]:
    """H11: from 97 % on, colour is divided by alpha and alpha is 1; the division happens in both branches."""
    solid = alpha >= 0.97
    return torch.where(solid[..., None], colour / alpha[..., None], colour), torch.where(solid, 1.0, alpha)


def facing_cosine(normal: Tensor, outgoing: Tensor) -> Tensor:
    """H13: the normal is turned by sign(n.v), which is 0 for a grazing view, and the cosine clamped in place."""
    turned = normal * (normal * outgoing).sum(-1, keepdim=True).sign()
    return (turned * outgoing).sum(-1).clamp_(1e-6, 1)


@pytest.mark.case(30)
def test_h4_the_mirrored_direction_leaves_the_surface() -> None:
    """Seen in a light of which only the mirrored texel shines: the released direction looks into the ground."""
    normal = unit(200)
    outgoing = normalize(normal + 0.9 * unit(200), dim=-1)
    into = mirrored(normal, outgoing)
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
    assert float(mirrored(up, view)[0, 2]) < 0


@pytest.mark.case(11)
def test_h7_both_passes_see_the_same_hits() -> None:
    """A surfel between the released passes' two starts, and more ties than a buffer holds."""
    between = 0.5 * (FORWARD_T_MIN + BACKWARD_T_MIN)
    theirs = [between > start for start in (FORWARD_T_MIN, BACKWARD_T_MIN)]
    assert theirs == [False, True]
    for start, met in ((BACKWARD_T_MIN, True), (FORWARD_T_MIN, False)):
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
    torch.cat([value.flatten() for value in saturated(colour, alpha)]).sum().backward()
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


@pytest.mark.case(26)
def test_h13_a_grazing_view_keeps_its_gradient() -> None:
    """n.v = 0 exactly, and 1e-8: the released normal becomes zero, and its clamp stops every pull."""
    normal = UP[None].clone().requires_grad_()
    for height in (0.0, 1e-8):
        view = torch.tensor([[1.0, 0.0, height]])
        cosine = facing_cosine(normal, view)
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
