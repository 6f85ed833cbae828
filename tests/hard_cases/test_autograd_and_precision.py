"""Cases 39, 40 and 42 to 44: divisions by zero behind sound values, finite differences, precision, repetition."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from cards import ON_CARD
from hard_cases.constructions import drawn, facing, looking_along_z, raw_surfels, rendered, two_balls
from radiogs_core.instruments import recording
from radiogs_core.kernels.rasterize.rasterize import rasterize
from radiogs_core.kernels.runtime import use_threads
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels
from radiogs_core.transport.sampling import hemisphere_directions
from radiogs_core.transport.splatting import (
    depth_normals,
    own_radiance,
    own_radiance_twice,
    shade_surfels,
    splat,
    towards,
)
from radiogs_core.transport.tracer import SurfelTracer
from reference.differences import slope

F64 = torch.float64
Values = dict[str, Tensor]


@pytest.mark.case(39)
def test_depth_and_normals_of_the_background_have_a_gradient_of_exactly_zero() -> None:
    """Half of the image is empty: no gradient of it reaches a surfel, and no division by its alpha matters."""
    camera = looking_along_z(12, 8)
    surfels = raw_surfels(4, spread=0.1)
    surfels.centre = surfels.centre + torch.tensor([-1.5, 0.0, 0.0])
    leaves = {name: value.requires_grad_() for name, value in surfels.parameters().items()}
    found = splat(camera, surfels, {"albedo": surfels.albedo}, 1.0)
    empty = found.alpha == 0
    assert 0.2 < float(empty.double().mean()) < 0.9
    normal = found.depth_normal(camera)
    (found.depth[empty].sum() + found.normal[empty].sum() + normal[empty].sum()).backward(retain_graph=True)
    assert all(leaf.grad is None or bool((leaf.grad == 0).all()) for leaf in leaves.values())
    (found.depth.sum() + normal.sum()).backward()
    assert all(leaf.grad is None or bool(torch.isfinite(leaf.grad).all()) for leaf in leaves.values())
    assert float(leaves["centre"].grad.abs().max()) > 0


@pytest.mark.case(40)
@pytest.mark.parametrize("length", [0.0, 1e-30, 1e-12, 1e-3])
def test_normals_of_vanishing_triangles_pull_by_a_bounded_force(length: float) -> None:
    """Coinciding points have no normal and no gradient; nearly coinciding ones, a gradient of their inverse distance.

    A direction's gradient is 1 / length: this is the true derivative, and gives the bound.
    """
    grid = torch.stack([*torch.meshgrid(torch.arange(5.0), torch.arange(5.0), indexing="xy"), torch.zeros(5, 5)], -1)
    points = (length * grid).requires_grad_()
    found = depth_normals(points, torch.tensor([0.0, 0.0, 1.0]))
    found[..., 0].sum().backward()
    assert bool(torch.isfinite(points.grad).all())
    # The cross product of float32 loses lengths below the root of its smallest number: no normal, no pull.
    assert float(points.grad.abs().max()) <= (1e4 if length == 1e-3 else 0 if length < 1e-18 else 4 / length)


@pytest.mark.case(40)
def test_normals_that_blend_to_zero_pull_by_a_bounded_force() -> None:
    """Two surfels with opposite tilt: the blend loses its length but is never divided by it in training."""
    camera = looking_along_z(3, 3)
    given = facing(torch.tensor([2.0, 2.1]), 0.5)
    given["normal"] = torch.tensor([[0.6, 0.0, -0.8], [-0.6, 0.0, -0.8]])
    leaves = {name: value.clone().requires_grad_() for name, value in given.items()}
    drawn(camera, leaves | {"features": torch.cat([leaves["normal"], leaves["normal"][:, :1]], -1)})[0].sum().backward()
    assert all(leaf.grad is None or float(leaf.grad.abs().max()) <= 1e4 for leaf in leaves.values())


CAMERA = looking_along_z(6, 4, focal=6.0, dtype=F64)
DIRECTIONS = 2
"""Random directions a parameter and scene: ten over the five scenes."""


class Frozen:
    """Everything that the method makes without gradient, made once: directions, views, footprints, start of rays."""

    def __init__(self, surfels: Surfels) -> None:
        with torch.no_grad():
            self.direction, self.weight = hemisphere_directions(surfels.frame[..., 2], 4, None)
            self.outgoing = towards(CAMERA, surfels)
            self.reach = surfels.scale.max(-1).values


def whole_render(parameters: Values, frozen: Frozen, pulls: list[Tensor]) -> Tensor:
    """Traced, shaded and splatted: the sum of pulls times the images of radiance, materials, depth and distortion."""
    surfels = Surfels.of({name: value for name, value in parameters.items() if name != "environment"})
    tracer = SurfelTracer(surfels)
    index = torch.arange(len(surfels))
    incident = tracer.incident(index, frozen.direction, frozen.weight)
    parts = shade_surfels(surfels, surfels.albedo, incident, frozen.outgoing[:, None], parameters["environment"])[:, 0]
    own = surfel_radiance(surfels.sh, frozen.outgoing)
    features = torch.cat([parts.sum(1) + own, surfels.albedo, surfels.roughness[:, None]], -1)
    raster = rasterize(CAMERA, surfels.geometry(), features, 3.0)
    images = (raster.features, raster.alpha, raster.depth, raster.distortion)
    return torch.stack([(image * pull).sum() for image, pull in zip(images, pulls, strict=True)]).sum()


@pytest.mark.slow
@pytest.mark.case(42)
@pytest.mark.parametrize("seed", range(5))
def test_gradients_of_the_whole_renderer_are_central_differences(seed: int) -> None:
    """Every raw parameter and the light, in random directions; no more than half of them may cross a threshold.

    Directions, footprints and the rays' start carry no gradient by design and are held still. Missing gradients show
    as rows that no difference misses: every surfel in view must pull on everything it is made of.
    """
    use_threads(1)
    torch.manual_seed(seed)
    surfels = raw_surfels(8, F64, spread=0.8)
    surfels.opacity_logit = surfels.opacity_logit.abs() - 1
    given = surfels.parameters() | {"environment": torch.rand(4, 8, 3, dtype=F64)}
    frozen = Frozen(surfels)
    pulls = [torch.randn(4, 6, 7, dtype=F64), *(0.3 * torch.randn(4, 6, dtype=F64) for _ in range(3))]
    leaves = {name: value.clone().requires_grad_() for name, value in given.items()}
    whole_render(leaves, frozen, pulls).backward()

    def value_of(values: Values) -> tuple[float, tuple[int, int]]:
        """The sum, and how many hits and pairs it is made of."""
        with recording() as instruments:
            total = float(whole_render(values, frozen, pulls))
        return total, (instruments.work["hits"], instruments.work["blended_pairs"])

    _, base = value_of(given)
    analytic, numeric, skipped = [], [], 0
    for name, value in given.items():
        assert leaves[name].grad is not None, name
        for _ in range(DIRECTIONS):
            shift, met = torch.randn_like(value), {base}

            def moved(amount: float, name: str = name, shift: Tensor = shift, met: set[tuple[int, int]] = met) -> float:
                total, hits = value_of(given | {name: given[name] + amount * shift})
                met.add(hits)
                return total

            found = slope(moved, 1e-5)
            if len(met) > 1:
                skipped += 1
                continue
            analytic.append(float((leaves[name].grad * shift).sum()))  # type: ignore[operator]
            numeric.append(found)
    assert skipped <= len(given) * DIRECTIONS // 2
    ours, expected = torch.tensor(analytic, dtype=F64), torch.tensor(numeric, dtype=F64)
    assert float(((ours - expected).abs() / (expected.abs() + 1e-3 * expected.abs().max())).max()) < 1e-3
    assert float(torch.nn.functional.cosine_similarity(ours, expected, dim=0)) > 0.9999
    for name in ("centre", "rotation", "log_scale", "opacity_logit", "sh", "albedo_logit", "roughness_logit"):
        rows = leaves[name].grad.reshape(8, -1).abs().amax(-1)  # type: ignore[union-attr]
        # A surfel that hides behind others is not in view; half of them always are.
        assert int((rows > 0).sum()) >= 4, f"no gradient to most of '{name}'"


@pytest.mark.case(42)
@pytest.mark.parametrize("seed", range(5))
def test_moving_a_surfel_also_turns_its_view_of_the_harmonics(seed: int) -> None:
    """Without the turn 14 to 40 % of the centre's gradient would be missing."""
    use_threads(1)
    torch.manual_seed(seed)
    surfels = raw_surfels(8, F64)
    base = surfels.centre.clone()

    def image(centre: Tensor, radiance: Callable[[Surfels], Tensor]) -> Tensor:
        of = Surfels.of(surfels.parameters() | {"centre": centre})
        return rasterize(CAMERA, of.geometry(), radiance(of), 1.0).features.sum()

    def gradient(radiance: Callable[[Surfels], Tensor]) -> Tensor:
        leaf = base.clone().requires_grad_()
        return torch.autograd.grad(image(leaf, radiance), leaf)[0]

    def own(of: Surfels) -> Tensor:
        return own_radiance(CAMERA, of)

    shift, met = torch.randn_like(base), set()

    def moved(amount: float) -> float:
        with recording() as instruments:
            total = float(image(base + amount * shift, own))
        met.add(instruments.work["blended_pairs"])
        return total

    numeric = slope(moved, 1e-6)
    assert len(met) == 1, "no threshold is crossed"
    assert float((gradient(own) * shift).sum()) == pytest.approx(numeric, rel=1e-6)
    still = gradient(lambda of: surfel_radiance(of.sh, towards(CAMERA, of)))
    assert float((gradient(own) - still).norm()) > 0.05 * float(still.norm())


@pytest.mark.case(42)
def test_radiance_that_a_turn_of_the_view_does_not_count_for_is_the_same_and_moves_no_surfel() -> None:
    surfels = raw_surfels(4)
    surfels.centre, surfels.sh = surfels.centre.requires_grad_(), surfels.sh.requires_grad_()
    camera = CAMERA.to(dtype=torch.float32)
    moving, still = own_radiance_twice(camera, surfels)
    assert torch.equal(moving, own_radiance(camera, surfels))
    assert torch.equal(still, moving)
    to_centre, to_sh = torch.autograd.grad(still.sum(), [surfels.centre, surfels.sh])
    assert not bool(to_centre.any())
    assert float(to_sh.abs().max()) > 0


@pytest.mark.case(42)
def test_a_surfel_at_the_cameras_centre_is_seen_from_nowhere() -> None:
    surfels = raw_surfels(3)
    surfels.centre = torch.cat([CAMERA.centre[None].float(), surfels.centre[1:]]).requires_grad_()
    radiance = own_radiance(CAMERA.to(dtype=torch.float32), surfels)
    (pull,) = torch.autograd.grad(radiance.sum(), surfels.centre)
    assert bool(torch.isfinite(radiance).all())
    assert bool((pull[0] == 0).all())
    assert float(pull[1:].abs().min(-1).values.max()) > 0


@pytest.mark.case(43)
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused_by_name(dtype: torch.dtype) -> None:
    given = {name: value.to(dtype) for name, value in facing(torch.tensor([2.0])).items()}
    with pytest.raises(TypeError, match="float32 or float64, not in"):
        drawn(looking_along_z(), given)


def _with_precision(precision: str, image: Callable[[], Tensor]) -> Tensor:
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision(precision)
    try:
        return image()
    finally:
        torch.set_float32_matmul_precision(before)


@pytest.mark.case(43)
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=ON_CARD)])
def test_matrix_products_of_reduced_precision_cost_less_than_sixty_decibels(device: str) -> None:
    """Importing the method leaves them at full precision; where somebody lowers it, the image stays within 1e-3."""
    assert torch.get_float32_matmul_precision() == "highest"
    surfels = Surfels.of({name: value.to(device) for name, value in two_balls().parameters().items()})
    camera = looking_along_z(16, 16)

    def image() -> Tensor:
        moved = Surfels.of(surfels.parameters() | {"centre": surfels.centre + torch.tensor([0, 0, 4.0], device=device)})
        features = torch.cat([moved.albedo, moved.roughness[:, None]], -1)
        return rasterize(camera, moved.geometry_for(camera), features, 1.0).features.double().cpu()

    full, reduced = _with_precision("highest", image), _with_precision("medium", image)
    assert float(full.max()) > 0.3
    assert float((full - reduced).square().mean()) <= 1e-6


@pytest.mark.case(44)
def test_images_and_gradients_repeat_bit_for_bit_and_images_on_any_number_of_threads() -> None:
    """Gradients are summed per worker: between teams of another size they differ by rounding, 1e-5 at most."""
    camera = looking_along_z(20, 15)

    def once(team: int) -> tuple[dict[str, Tensor], Values]:
        use_threads(team)
        torch.manual_seed(3)
        surfels = raw_surfels(100)
        images = rendered(surfels, camera, 8)
        leaves = {name: value.clone().requires_grad_() for name, value in surfels.parameters().items()}
        of = Surfels.of(leaves)
        found = splat(camera, of, {"radiance": surfel_radiance(of.sh, towards(camera, of))}, 3.0)
        (found.images["radiance"].square().sum() + found.depth.sum() + found.distortion.sum()).backward()
        return images, {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}

    results = {team: (once(team), once(team)) for team in (1, 4)}
    for (images, gradients), (again, gradients_again) in results.values():
        assert all(torch.equal(images[name], again[name]) for name in images)
        assert all(torch.equal(gradients[name], gradients_again[name]) for name in gradients)
    (alone, slopes), (crowd, other_slopes) = results[1][0], results[4][0]
    assert all(torch.equal(alone[name], crowd[name]) for name in alone)
    for name, value in slopes.items():
        assert float((value - other_slopes[name]).abs().max()) <= 1e-5 * float(value.abs().max())
