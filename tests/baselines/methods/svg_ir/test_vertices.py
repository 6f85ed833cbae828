"""Attributes at vertices: bilinear within a surfel, blended exactly as the rasterizer does, with gradients."""

import pytest
import torch

from baselines.methods.irgs.world import looking_down, sheet, together
from hard_cases.constructions import looking_along_z, raw_surfels
from radiogs_baselines.methods.svg_ir import vertices
from radiogs_baselines.methods.svg_ir.vertices import bilinear, blend_vertices
from radiogs_core.kernels.rasterize.projection import project
from radiogs_core.kernels.rasterize.rasterize import blend
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.surfels import Surfels
from reference.differences import Values, assert_gradients

F64 = torch.float64


def blended(camera: Camera, surfels: Surfels, attributes: torch.Tensor, distance: float = 1.5) -> torch.Tensor:
    camera = camera.to(surfels.centre.device, surfels.centre.dtype)
    return blend_vertices(project(camera, surfels.geometry_for(camera)), surfels, attributes, distance)


def crowd(count: int = 200) -> Surfels:
    """Surfels of all opacities, enough of them for pixels to stop early."""
    surfels = raw_surfels(count)
    return Surfels.of({name: value.double() for name, value in surfels.parameters().items()})


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("at_once", [64, 1 << 18])
def test_equal_vertices_give_the_image_of_the_rasterizer(
    count: int, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(vertices, "ENTRIES_AT_ONCE", at_once)
    surfels = crowd()
    surfels.opacity_logit = surfels.opacity_logit + 3
    camera = looking_along_z(33, 15).to(surfels.centre.device, F64)
    features = torch.randn(len(surfels), 5, dtype=F64, generator=torch.Generator().manual_seed(0))
    expected = blend(project(camera, surfels.geometry_for(camera)), features, 1.0)
    found = blended(camera, surfels, features[:, None].expand(-1, count, -1))
    assert float(expected.alpha.max()) > 0.999, "pixels that end early"
    torch.testing.assert_close(found, expected.features, rtol=1e-9, atol=1e-10)


def test_bilinear_weights_at_and_beyond_the_vertices() -> None:
    corners = torch.tensor([[-1.5, -1.5], [1.5, -1.5], [-1.5, 1.5], [1.5, 1.5]])
    assert torch.equal(bilinear(corners, 1.5, 4), torch.eye(4))
    torch.testing.assert_close(bilinear(torch.tensor([0.75, 0.0]), 1.5, 4), torch.tensor([0.125, 0.375, 0.125, 0.375]))
    assert torch.equal(bilinear(torch.tensor([9.0, -9.0]), 1.5, 4), torch.tensor([0.0, 1.0, 0.0, 0.0]))
    assert torch.equal(bilinear(torch.tensor([0.4, 7.0]), 1.5, 1), torch.ones(1))


def test_a_pixel_shows_the_attributes_at_its_own_uv() -> None:
    """A sheet seen from one unit above: the pixel through (x, y) shows the bilinear function there, although the surfel
    is widened by the pixel's footprint.
    """
    surfels = sheet(0.0, scale=0.5, dtype=F64)
    camera = looking_down(1.0, 9, F64)
    u, v = surfels.frame[0, :, 0], surfels.frame[0, :, 1]
    rays = camera.ray_directions()
    position = camera.centre + rays * (1.0 / -rays[..., 2:])
    values = torch.tensor([1.0, 2.0, 4.0, 9.0], dtype=F64)
    right, up = (((position @ axis) / 0.5 / 0.8).clamp(-1, 1) / 2 + 0.5 for axis in (u, v))
    expected = (1 - up) * (values[0] * (1 - right) + values[1] * right) + up * (
        values[2] * (1 - right) + values[3] * right
    )
    attributes = torch.stack([values, torch.ones_like(values)], -1)[None]
    found, alpha = blended(camera, surfels, attributes, 0.8).unbind(-1)
    assert float(expected.max() - expected.min()) > 1
    torch.testing.assert_close(found / alpha, expected, rtol=1e-9, atol=1e-9)


def test_gradients_equal_central_differences() -> None:
    """To opacity, in the pixel's order of surfels, and to attributes."""
    surfels = together(
        sheet(0.0, (0.1, 0.0, 0.995), 0.4, 0.6, dtype=F64), sheet(-0.2, scale=0.6, opacity=0.5, dtype=F64)
    )
    camera = looking_down(1.5, 5, F64)
    torch.manual_seed(0)
    pull = torch.randn(5, 5, 2, dtype=F64)

    def total(values: Values) -> torch.Tensor:
        given = Surfels.of(surfels.parameters() | {"opacity_logit": values["opacity_logit"]})
        return (blended(camera, given, values["attributes"]) * pull).sum()

    def hits(values: Values) -> object:
        return _supports(surfels, values["opacity_logit"], camera)

    values = {"attributes": torch.randn(2, 4, 2, dtype=F64), "opacity_logit": surfels.opacity_logit}
    leaves = {name: value.clone().requires_grad_() for name, value in values.items()}
    total(leaves).backward()
    gradients = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    assert set(gradients) == set(values)
    assert_gradients(lambda moved: float(total(moved)), values, gradients, 1e-3, hits)


def _supports(surfels: Surfels, opacity_logit: torch.Tensor, camera: Camera) -> object:
    """The pixels that each surfel reaches."""
    given = Surfels.of(surfels.parameters() | {"opacity_logit": opacity_logit})
    seen = [given.take(torch.tensor([k])) for k in range(len(given))]
    return [(blended(camera, one, torch.ones(1, 1, 1, dtype=F64)) > 0).flatten().tolist() for one in seen]


def test_an_empty_view_is_black() -> None:
    surfels = sheet(50.0)
    assert torch.equal(blended(looking_down(), surfels, torch.ones(1, 4, 3)), torch.zeros(3, 3, 3))
