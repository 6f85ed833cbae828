import math
from dataclasses import replace

import pytest
import torch

from radiogs_core.kernels.surfel.footprint import frames
from radiogs_core.scene.camera import Camera
from radiogs_core.surfels import surfels as surfels_module
from radiogs_core.surfels.harmonics import surfel_radiance
from radiogs_core.surfels.surfels import Surfels, radiance_to_sh, roughness_to_logit, surfels_at
from radiogs_core.transport.splatting import splat


def _surfels(count: int = 20) -> Surfels:
    generator = torch.Generator().manual_seed(1)
    points = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    return surfels_at(points, torch.full((count,), 0.1, dtype=torch.float64), 5 * points, generator)


def test_framed_surfels_compute_their_frames_once_and_pass_the_gradient_on(monkeypatch: pytest.MonkeyPatch) -> None:
    surfels, computed = _surfels(), []
    monkeypatch.setattr(surfels_module, "frames", lambda rotation: computed.append(1) or frames(rotation))
    surfels.rotation.requires_grad_()
    framed = surfels.with_cached_values()
    pull = torch.randn(20, 3, 3, dtype=torch.float64)
    (framed.frame * pull).sum().backward()
    found, surfels.rotation.grad = surfels.rotation.grad, None
    assert torch.equal(framed.frame, framed.frame)
    assert len(computed) == 1
    (surfels.frame * pull).sum().backward()
    assert found is not None
    torch.testing.assert_close(found, surfels.rotation.grad)


def test_a_pixels_footprint_widens_surfels_but_keeps_their_energy() -> None:
    surfels = _surfels()
    camera = Camera(torch.eye(4, dtype=torch.float64), 50.0, 50.0, 32.0, 32.0, 64, 64)
    surfels.centre = surfels.centre + torch.tensor([0.0, 0.0, 10.0], dtype=torch.float64)
    own, seen = surfels.geometry(), surfels.geometry_for(camera)

    def energy(geometry: object) -> torch.Tensor:
        axes = geometry.axis_u, geometry.axis_v  # type: ignore[attr-defined]
        return geometry.opacity / torch.linalg.cross(*axes).norm(dim=-1)  # type: ignore[attr-defined]

    torch.testing.assert_close(energy(own), energy(seen))
    assert (seen.axis_u.norm(dim=-1) < own.axis_u.norm(dim=-1)).all()


@pytest.mark.parametrize("degrees", [60.0, 80.0, 85.0])
def test_a_surfel_seen_from_the_edge_covers_what_its_projection_does_wherever_it_falls(degrees: float) -> None:
    """A disc of 2.5 pixels: its alpha, summed over pixels, is the head-on disc's alpha times the cosine."""
    camera = Camera(torch.eye(4), 50.0, 50.0, 16.0, 16.0, 32, 32)
    found = []
    for shift in torch.linspace(0, 0.9, 7):
        for angle in (0.0, math.radians(degrees)):
            one = surfels_at(
                torch.tensor([[0.2 * float(shift), 0.13 * float(shift), 10.0]]), torch.tensor([0.5]),
                torch.zeros(1, 3), torch.Generator().manual_seed(0),
            )  # fmt: skip
            half = (math.pi - angle) / 2
            turned = torch.tensor([[math.cos(half), math.sin(half) * 0.6, math.sin(half) * 0.8, 0.0]])
            one = replace(one, rotation=turned, opacity_logit=torch.tensor([2.0]))
            found.append(float(splat(camera, one, {}, 1.0).alpha.sum()))
    ratios = torch.tensor(found).view(-1, 2)
    share = ratios[:, 1] / ratios[:, 0]
    torch.testing.assert_close(share, torch.full_like(share, math.cos(math.radians(degrees))), rtol=0.12, atol=0.0)


def test_fresh_surfels_face_where_they_are_seen_from() -> None:
    surfels = _surfels(200)
    assert ((surfels.frame[..., 2] * (5 * surfels.centre - surfels.centre)).sum(-1) > 0).all()


def test_inverse_activations_invert_the_activations() -> None:
    surfels = _surfels()
    surfels.roughness_logit = torch.full((20,), roughness_to_logit(0.37), dtype=torch.float64)
    torch.testing.assert_close(surfels.roughness, torch.full((20,), 0.37, dtype=torch.float64))
    surfels.sh[:, 0] = radiance_to_sh(torch.full((20, 3), 2.5, dtype=torch.float64))
    outgoing = surfels.frame[..., 2]
    torch.testing.assert_close(surfel_radiance(surfels.sh, outgoing), torch.full((20, 3), 2.5, dtype=torch.float64))
