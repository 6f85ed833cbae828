"""K3 against a dense float64 implementation, finite differences and furnaces."""

import sys
from collections.abc import Callable

import pytest
import torch

from radiogs_core.instruments import recording
from radiogs_core.kernels.runtime import launch_in_parallel, use_threads
from radiogs_core.kernels.shade.consistency import consistency_of
from radiogs_core.kernels.shade.shade import LANES_ON_CPU, arrive, shade, shade_total
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.transport.sampling import hemisphere_directions
from reference.differences import Values, assert_gradients, assert_same_slopes, gradients_of
from reference.shade import shade as dense_shade

NAMES = ("normal", "albedo", "roughness", "outgoing", "direction", "weight", "visibility", "indirect", "environment")

in_every_arrangement = pytest.mark.usefixtures("arrangement")
DIFFERENTIABLE = ("normal", "albedo", "roughness", "visibility", "indirect", "environment")


def unit(*shape: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(*shape, dtype=torch.float64), dim=-1)


def inputs(surfels: int = 12, views: int = 2, samples: int = 16) -> Values:
    normal = unit(surfels, 3)
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(0))
    return {
        "normal": normal,
        "albedo": torch.rand(surfels, 3, dtype=torch.float64),
        "roughness": 0.1 + 0.9 * torch.rand(surfels, dtype=torch.float64),
        "outgoing": unit(surfels, views, 3),
        "direction": torch.where(torch.rand(surfels, samples, 1) < 0.1, -direction, direction),
        "weight": weight,
        "visibility": torch.rand(surfels, samples, dtype=torch.float64),
        "indirect": torch.rand(surfels, samples, 3, dtype=torch.float64),
        "environment": torch.rand(6, 12, 3, dtype=torch.float64),
    }


def gradients(function: Callable[..., torch.Tensor], given: Values, pull: torch.Tensor) -> Values:
    return gradients_of(lambda leaves: [function(*leaves.values())], given, [pull], DIFFERENTIABLE)


@in_every_arrangement
@pytest.mark.parametrize(
    ("views", "samples"), [(1, 1), (2, LANES_ON_CPU), (3, LANES_ON_CPU + 1), (1, 2 * LANES_ON_CPU - 1), (2, 64)]
)
def test_float64_equals_the_dense_sum_and_its_gradients(views: int, samples: int) -> None:
    """Also where the samples do not fill their last block."""
    given = inputs(views=views, samples=samples)
    found, expected = shade(*given.values()), dense_shade(*given.values())
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-13)
    pull = torch.randn_like(found)
    assert_same_slopes(gradients(shade, given, pull), gradients(dense_shade, given, pull))


def framed(given: Values) -> Values:
    """The inputs of ``shade_total``: the normals are the third columns of frames."""
    frame = torch.randn(len(given["normal"]), 3, 3, dtype=torch.float64)
    frame[..., 2] = given["normal"]
    return {"frame": frame, **{name: value for name, value in given.items() if name != "normal"}}


def slopes_of(value: torch.Tensor, leaves: Values) -> Values:
    return dict(zip(leaves, torch.autograd.grad(value, list(leaves.values())), strict=True))


def assert_equal_slopes(found: torch.Tensor, expected: torch.Tensor, leaves: Values) -> None:
    assert_same_slopes(slopes_of(found, leaves), slopes_of(expected, leaves))


@in_every_arrangement
@pytest.mark.parametrize("samples", [LANES_ON_CPU + 1, 32])
def test_the_total_is_the_sum_of_the_parts(samples: int) -> None:
    given = framed(inputs(samples=samples))
    learnt = {name: value.requires_grad_() for name, value in given.items() if name in (*DIFFERENTIABLE, "frame")}
    found = shade_total(*given.values())
    expected = dense_shade(given["frame"][..., 2], *list(given.values())[1:]).sum(2)
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-13)
    pull = torch.randn_like(found)
    assert_equal_slopes((found * pull).sum(), (expected * pull).sum(), learnt)


@in_every_arrangement
@pytest.mark.parametrize("at_once", [2**31 - 1, 2 * 3 * 3 * 20])
def test_sets_of_samples_share_the_values_of_their_surfel(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where two surfels at a time are shaded, of five."""
    monkeypatch.setattr("radiogs_core.kernels.shade.shade.MOST_ENTRIES", at_once)
    surfels, rows = framed(inputs(surfels=5, samples=20)), inputs(surfels=15, samples=20)
    samples = ("direction", "weight", "visibility", "indirect")
    given = {name: rows[name] if name in samples else value for name, value in surfels.items()}
    lobes = torch.tensor([True, False, True, True, False])
    learnt = {name: value.requires_grad_() for name, value in given.items() if name in (*DIFFERENTIABLE, "frame")}
    found = shade_total(*given.values(), lobes)
    alone = {
        name: value if name in (*samples, "environment") else value.repeat_interleave(3, 0)
        for name, value in given.items()
    }
    expected = shade_total(*alone.values(), lobes.repeat_interleave(3))
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-14)
    pull = torch.randn_like(found)
    assert_equal_slopes((found * pull).sum(), (expected * pull).sum(), learnt)


@in_every_arrangement
def test_radiance_that_has_arrived_is_shaded_as_the_light_that_it_comes_from() -> None:
    """Radiance of some surfels is written between other surfels' radiance, which stays."""
    given = framed(inputs(samples=LANES_ON_CPU + 5))
    index = torch.tensor([7, 0, 3])
    samples = [given[name][index] for name in ("direction", "visibility", "indirect")]
    whole = torch.full_like(given["direction"], 7.0)
    arrive(whole, index, *samples, given["environment"])
    others = torch.tensor([each for each in range(12) if each not in index])
    assert bool((whole[others] == 7.0).all())
    some = {name: value if name == "environment" else value[index] for name, value in given.items()}
    learnt = {name: some[name].requires_grad_() for name in ("frame", "albedo", "roughness")}
    expected = shade_total(*some.values())
    found = shade_total(*{**some, "visibility": None, "indirect": whole[index], "environment": None}.values())
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-14)
    pull = torch.randn_like(found)
    assert_equal_slopes((found * pull).sum(), (expected * pull).sum(), learnt)


def test_light_arriving_at_a_surfel_is_bitwise_independent_of_others() -> None:
    """A resumed stage computes all of it at once, and a stage that runs on computes some at a time."""
    given = {name: value.float() for name, value in inputs(samples=LANES_ON_CPU + 5).items()}
    names, every = ("direction", "visibility", "indirect"), torch.arange(12)
    at_once, in_turn = torch.empty_like(given["direction"]), torch.empty_like(given["direction"])
    arrive(at_once, every, *(given[name] for name in names), given["environment"])
    for index in every.flip(0).split(5):
        arrive(in_turn, index, *(given[name][index] for name in names), given["environment"])
    assert torch.equal(at_once, in_turn)


def test_gradients_equal_central_differences_in_random_directions() -> None:
    given = inputs(surfels=4)
    pull = torch.randn(4, 2, 4, 3, dtype=torch.float64)

    def total(values: Values) -> float:
        return float((shade(*values.values()) * pull).sum())

    assert_gradients(total, given, gradients(shade, given, pull), 2e-4)


@in_every_arrangement
def test_float32_agrees_with_float64_on_the_rounded_inputs() -> None:
    given = {name: value.float() for name, value in inputs(surfels=200).items()}
    rounded = {name: value.double() for name, value in given.items()}
    pull = torch.randn(200, 2, 4, 3)
    ours, exact = gradients(shade, given, pull), gradients(shade, rounded, pull.double())
    for name in DIFFERENTIABLE:
        error = (ours[name].double() - exact[name]).abs() / exact[name].abs().max()
        assert (error < 1e-4).double().mean() > 0.99, name


def compared() -> Values:
    """The inputs of ``consistency_of``: 12 surfels, of which 5 are compared; one of them is seen from behind."""
    given, index = framed(inputs(samples=LANES_ON_CPU + 3)), torch.tensor([9, 2, 11, 5, 0])
    normal, camera = given["frame"][..., 2], 5 * unit(3)
    drawn = 3 * torch.randn(5, 3, dtype=torch.float64)
    ours = {
        "index": index,
        "camera": camera,
        "drawn": drawn,
        "centre": torch.where((normal @ camera < 0)[:, None], 2 * camera, 0) + 0.1 * unit(12, 3),
        "sh": 0.8 * torch.randn(12, 16, 3, dtype=torch.float64),
    }
    ours["centre"][9] = ours["camera"] + normal[9]
    of_samples = ("direction", "weight", "visibility", "indirect")
    rest = {name: value[index] if name in of_samples else value for name, value in given.items() if name != "outgoing"}
    return ours | rest


def plain_consistency(given: Values, specular_at: torch.Tensor, detach: str) -> torch.Tensor:
    """L_rad as separate operations."""
    index, camera, drawn, centre, sh, frame, albedo, roughness, *light = given.values()
    normal = frame[index][..., 2]
    with torch.no_grad():
        towards = [torch.nn.functional.normalize(each, dim=-1) for each in (camera - centre[index], drawn)]
        towards[1] = torch.where((towards[1] * normal).sum(-1, keepdim=True) < 0, -towards[1], towards[1])
        outgoing = torch.stack(towards, 1)
        facing = (outgoing * normal[:, None]).sum(-1, keepdim=True) > 0
    assert 0 < int((~facing).sum()) < 5
    parts = dense_shade(normal, albedo[index], roughness[index], outgoing, *light)
    lobes = torch.tensor([1.0, 1, 0, 0]) + specular_at[index].double()[:, None] * torch.tensor([0.0, 0, 1, 1])
    physical = (parts * lobes[:, None, :, None]).sum(2)
    own = surfel_radiance(sh[index], outgoing)
    own, physical = own.detach() if detach == "own" else own, physical.detach() if detach == "physical" else physical
    return torch.where(facing, own - physical, 0.0).abs().sum(1).mean()


@in_every_arrangement
@pytest.mark.parametrize("light_learns", [False, True])
@pytest.mark.parametrize("detach", ["none", "own", "physical"])
def test_consistency_equals_separate_operations_and_their_gradients(detach: str, light_learns: bool) -> None:
    given, specular_at = compared(), torch.rand(12) < 0.7
    sides = {
        "none": ("sh", "frame", "albedo", "roughness", "visibility", "indirect", "environment"),
        "physical": ("sh",),
    }
    sides["own"] = sides["none"][1:]
    learnt = {n: given[n].requires_grad_() for n in sides[detach] if light_learns or n != "environment"}
    found = consistency_of(*given.values(), specular_at, detach != "own", detach != "physical")
    expected = plain_consistency(given, specular_at, detach)
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=0)
    assert_equal_slopes(2 * found, 2 * expected, learnt)


@pytest.mark.parametrize("samples", [4, 16, 64, 256])
def test_white_furnace_has_no_bias_at_any_number_of_samples(samples: int) -> None:
    """A white Lambert surface under constant light 1 sends 1 (the sample set's cosines sum to exactly pi)."""
    normal = unit(50, 3)
    direction, weight = hemisphere_directions(normal, samples, torch.Generator().manual_seed(0))
    one = torch.ones(50, samples, dtype=torch.float64)
    parts = shade(
        normal, torch.ones_like(normal), torch.ones(50, dtype=torch.float64), normal[:, None], direction, weight,
        one, one[..., None].expand(-1, -1, 3) * 0, torch.ones(4, 8, 3, dtype=torch.float64),
    )  # fmt: skip
    torch.testing.assert_close(parts[:, 0, 0], torch.ones_like(normal), rtol=1e-12, atol=0)


@in_every_arrangement
def test_lookup_crosses_the_seam_and_reaches_the_poles_without_a_step() -> None:
    """Either side of the map's edge, and a step away from each pole, against the map's own lookup in float32."""
    light = EnvironmentMap(torch.rand(8, 16, 3))
    angle = torch.tensor([torch.pi - 1e-4, -torch.pi + 1e-4])
    toward = torch.cat([
        torch.stack([angle.cos(), angle.sin(), torch.zeros(2)], -1),
        torch.tensor([[1e-4, 0.0, 1.0], [1e-20, 1e-20, -1.0], [0.0, 0.0, 1.0]]),
    ])  # fmt: skip
    parts = shade(
        toward, torch.full((5, 3), torch.pi), torch.ones(5), toward[:, None], toward[:, None], torch.ones(5, 1),
        torch.ones(5, 1), torch.zeros(5, 1, 3), light.radiance,
    )  # fmt: skip
    torch.testing.assert_close(parts[:, 0, 0], light.lookup(toward), rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(parts[0, 0, 0], parts[1, 0, 0], rtol=0, atol=1e-3)


@in_every_arrangement
@pytest.mark.parametrize("roughness", [1e-3, 0.02, 0.1, 1.0])
def test_sharp_lobes_keep_their_digits_in_float32(roughness: float) -> None:
    """Mirrored pairs within ten widths of the peak, against the dense sum in float64 on the same rounded inputs."""
    count = 2000
    normal = unit(count, 3)
    sideways = torch.nn.functional.normalize(torch.linalg.cross(normal, unit(count, 3)), dim=-1)
    half = normal + roughness**2 * torch.logspace(-3, 1, count, dtype=torch.float64)[:, None] * sideways
    half = torch.nn.functional.normalize(half, dim=-1)
    wo = torch.nn.functional.normalize(half + 0.7 * unit(count, 3), dim=-1)
    wi = 2 * (wo * half).sum(-1, keepdim=True) * half - wo
    both = ((wo * normal).sum(-1) > 0.05) & ((wi * normal).sum(-1) > 0.05)
    normal, wo, wi = (value[both].float() for value in (normal, wo, wi))
    count = len(normal)
    given = [
        normal, torch.ones(count, 3), torch.full((count,), roughness), wo[:, None], wi[:, None], torch.ones(count, 1),
        torch.ones(count, 1), torch.zeros(count, 1, 3), torch.ones(4, 8, 3),
    ]  # fmt: skip
    found, exact = shade(*given)[:, 0, 2].double(), dense_shade(*(value.double() for value in given))[:, 0, 2]
    assert float(((found - exact) / exact).abs().max()) < 1e-5  # measured 1e-6 (4e-6 at roughness 1)


def test_each_view_is_the_same_alone_as_among_others() -> None:
    """Views share the look-up of the light and the diffuse sums."""
    given = inputs(views=3)
    together = shade(*given.values())
    for view in range(3):
        alone = shade(*{**given, "outgoing": given["outgoing"][:, view : view + 1]}.values())
        assert torch.equal(alone[:, 0], together[:, view])


def test_opposed_grazing_directions_give_finite_values_and_gradients() -> None:
    """Where wo = -wi there is no half-vector; on the horizon itself there is no light."""
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(4, 3)
    outgoing = torch.tensor([[1.0, 0.0, 0.0], [1.0, 0.0, 1e-8], [0.6, 0.0, 0.8], [0.0, 0.0, -1.0]])
    direction = torch.tensor([[-1.0, 0.0, 0.0], [-1.0, 0.0, 1e-8], [-0.6, 0.0, -0.8], [0.0, 0.0, 1.0]])
    given = {
        "normal": normal, "albedo": torch.ones(4, 3), "roughness": torch.full((4,), 0.02),
        "outgoing": outgoing[:, None], "direction": direction[:, None], "weight": torch.ones(4, 1),
        "visibility": torch.ones(4, 1), "indirect": torch.ones(4, 1, 3), "environment": torch.ones(4, 8, 3),
    }  # fmt: skip
    out = shade(*given.values())
    assert torch.isfinite(out).all()
    assert bool((out[[0, 2, 3]] == 0).all())
    assert all(torch.isfinite(slope).all() for slope in gradients(shade, given, torch.ones_like(out)).values())


@pytest.mark.usefixtures("cpu_arrangement")
@pytest.mark.parametrize("team", [1, 2])
def test_results_repeat_bit_for_bit(team: int) -> None:
    use_threads(team)
    given = {name: value.float() for name, value in inputs(surfels=100).items()}
    pull = torch.randn(100, 2, 4, 3)
    first, second = gradients(shade, given, pull), gradients(shade, given, pull)
    assert all(torch.equal(first[name], second[name]) for name in DIFFERENTIABLE)


def test_no_surfel_gives_no_radiance() -> None:
    given = {name: value[:0] for name, value in inputs().items() if name != "environment"}
    assert shade(*given.values(), torch.ones(4, 8, 3, dtype=torch.float64)).shape == (0, 2, 4, 3)


@in_every_arrangement
def test_a_surfel_that_is_not_finite_disturbs_no_other_and_reads_nothing_off_the_map() -> None:
    given = inputs(surfels=6)
    whole = shade(*given.values())
    given["normal"][2] = torch.nan
    given["normal"][4] = torch.inf
    others = [0, 1, 3, 5]
    assert torch.equal(shade(*given.values())[others], whole[others])
    slopes = gradients(shade, given, torch.ones_like(whole))
    assert all(torch.isfinite(slopes[name][others]).all() for name in ("normal", "albedo", "roughness"))


def test_every_sample_of_every_view_is_counted() -> None:
    with recording() as instruments:
        shade(*inputs(surfels=5, views=3, samples=7).values())
    assert instruments.work["shaded_samples"] == 5 * 3 * 7


def test_more_samples_than_a_kernel_counts_are_shaded_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    given = inputs(surfels=11, samples=16)
    whole = shade(*given.values())
    pull = torch.randn_like(whole)
    at_once = gradients(shade, given, pull)
    monkeypatch.setattr(sys.modules["radiogs_core.kernels.shade.shade"], "MOST_ENTRIES", 3 * 16 * 4)
    launches = []
    launch = launch_in_parallel
    monkeypatch.setattr(
        sys.modules["radiogs_core.kernels.shade.shade"],
        "launch_in_parallel",
        lambda kernel, count, *rest: launches.append(count) or launch(kernel, count, *rest),
    )
    assert torch.equal(shade(*given.values()), whole)
    assert launches == [4, 4, 3]
    for name, gradient in gradients(shade, given, pull).items():
        torch.testing.assert_close(gradient, at_once[name], rtol=1e-12, atol=1e-14)
