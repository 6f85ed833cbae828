"""Gradients in float64 against central differences, and parameters without gradient."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from baselines.methods.tensoir.world import BUDGET, random_field, whole_box
from radiogs_baselines.methods.tensoir.drawing import RayBatch
from radiogs_baselines.methods.tensoir.field import Field
from radiogs_baselines.methods.tensoir.light import SphericalGaussians, light_start
from radiogs_baselines.methods.tensoir.marching import Rays, march
from radiogs_baselines.methods.tensoir.model import LIGHT, Model
from radiogs_baselines.methods.tensoir.settings import LightStart, Variant
from radiogs_baselines.methods.tensoir.training import inverse_losses

STEP = 1e-6


def rays(count: int = 6) -> Rays:
    generator = torch.Generator().manual_seed(3)
    origin = 2.5 * torch.nn.functional.normalize(torch.randn(count, 3, generator=generator).double(), dim=-1)
    towards = 0.5 * torch.rand(count, 3, generator=generator).double() - origin
    return Rays(origin, torch.nn.functional.normalize(towards, dim=-1))


def parameters() -> dict[str, Tensor]:
    """Parameters of a field dense enough for surface points, and of a light."""
    field = random_field(box=whole_box(dtype=torch.float64))
    light = light_start(4, LightStart(), torch.Generator().manual_seed(0)).double()
    grids = dict(field.parameters)
    grids["density_plane"] = grids["density_plane"].clone()
    grids["density_line"] = grids["density_line"].clone()
    grids["density_plane"][0, :, :, 0], grids["density_line"][0, :, 0] = 3.0, 3.0
    return {**grids, LIGHT: light}


def losses_of(tensors: dict[str, Tensor], variant: Variant, some: Rays) -> dict[str, Tensor]:
    field = Field(whole_box(dtype=torch.float64), {name: value for name, value in tensors.items() if name != LIGHT})
    target = torch.linspace(0.1, 0.9, 3 * len(some), dtype=torch.float64).view(-1, 3)
    model = Model(field, SphericalGaussians(tensors[LIGHT]))
    background = torch.linspace(0, 1, len(some), dtype=torch.float64)[:, None]
    return inverse_losses(model, RayBatch(some, target, background), variant, BUDGET, torch.Generator().manual_seed(1))


def check(function: Callable[[dict[str, Tensor]], Tensor], tensors: dict[str, Tensor], names: list[str]) -> None:
    """Compare gradients with central differences along a random direction of each tensor."""
    leaves = {name: value.clone().requires_grad_() for name, value in tensors.items()}
    function(leaves).backward()
    for name in names:
        direction = torch.randn(tensors[name].shape, generator=torch.Generator().manual_seed(5)).double()
        direction /= direction.norm()
        moved = [function({**tensors, name: tensors[name] + sign * STEP * direction}) for sign in (1, -1)]
        expected = float((moved[0] - moved[1]) / (2 * STEP))
        grad = leaves[name].grad
        assert grad is not None, name
        found = float((grad * direction).sum())
        assert found != 0, name
        assert found == pytest.approx(expected, rel=2e-4, abs=1e-10), name


FIELD = ["density_plane", "density_line", "appearance_plane", "appearance_line", "basis"]


def test_gradients_of_marched_pixels_equal_central_differences() -> None:
    names = [*FIELD, "radiance_weight_0", "radiance_bias_1", "radiance_weight_2"]
    check(lambda tensors: losses_of(tensors, Variant(), rays())["radiance"], parameters(), names)


def test_gradients_of_the_normal_losses_equal_central_differences() -> None:
    """They reach the network and, through the slopes of the factors, the density."""
    names = [*FIELD, "normal_weight_0", "normal_bias_2"]
    check(lambda tensors: losses_of(tensors, Variant(), rays())["normal difference"], parameters(), names)


@pytest.mark.parametrize("loss", ["albedo smoothness", "roughness smoothness"])
def test_gradients_of_the_smoothness_losses_equal_central_differences(loss: str) -> None:
    check(lambda tensors: losses_of(tensors, Variant(), rays())[loss], parameters(), [*FIELD, "brdf_weight_1"])


def test_gradients_of_shaded_pixels_equal_central_differences() -> None:
    """Without visibility and indirect light, whose rays have no gradient; density acts through blended materials."""
    variant = Variant(visibility=False, indirect=False)
    names = [*FIELD, "brdf_weight_0", "brdf_bias_2", "normal_weight_1", LIGHT]
    check(lambda tensors: losses_of(tensors, variant, rays())["shaded"], parameters(), names)
    with_both = parameters()
    check(lambda tensors: losses_of(tensors, Variant(), rays())["shaded"], with_both, ["brdf_bias_2", LIGHT])


def test_secondary_rays_have_no_gradient() -> None:
    """The radiance network acts on shaded pixels only through L_ind: it gets no gradient, although it changes them."""
    leaves = {name: value.clone().requires_grad_() for name, value in parameters().items()}
    losses_of(leaves, Variant(), rays())["shaded"].backward()
    assert all(leaves[name].grad is None for name in leaves if name.startswith("radiance"))
    brighter = parameters()
    brighter["radiance_bias_2"] = brighter["radiance_bias_2"] + 3
    assert losses_of(brighter, Variant(), rays())["shaded"] != losses_of(parameters(), Variant(), rays())["shaded"]


def test_shading_with_derived_normals_has_gradient_to_density() -> None:
    variant = Variant(normals="derived", visibility=False, indirect=False)
    check(
        lambda tensors: losses_of(tensors, variant, rays())["shaded"], parameters(), ["density_plane", "density_line"]
    )
    assert "normal difference" not in losses_of(parameters(), variant, rays())


def test_weights_equal_a_loop_over_each_ray() -> None:
    """T_k alpha_k from the formula, in a box with half of its cells empty."""
    box = whole_box(dtype=torch.float64)
    box = box.narrowed(torch.rand(box.occupied.shape, generator=torch.Generator().manual_seed(0)) > 0.5)
    field = Field(box, {name: value for name, value in parameters().items() if name != LIGHT})
    marched = march(field, rays())
    samples = marched.samples
    step = field.spacing / 2
    for ray in range(len(rays())):
        transmittance, total = 1.0, 0.0
        for index in torch.nonzero(samples.ray == ray)[:, 0]:
            opacity = 1 - float(torch.exp(-field.density(samples.position[index][None]) * step))
            assert float(marched.weight[index]) == pytest.approx(transmittance * opacity, rel=1e-9, abs=1e-300)
            total += transmittance * opacity
            transmittance *= 1 - opacity
        assert float(marched.alpha[ray]) == pytest.approx(total, rel=1e-9)
    assert bool(box.holds(samples.position).all())
