import pytest
import torch

from radiogs_core.scene.light import EnvironmentMap, texel_directions, texel_solid_angles


def test_every_texel_is_found_again_in_its_own_direction() -> None:
    light = EnvironmentMap(torch.rand(8, 16, 3, dtype=torch.float64))
    torch.testing.assert_close(light.lookup(texel_directions(8, 16)), light.radiance)


@pytest.mark.parametrize(
    ("direction", "column", "row"),
    [((1, 0, 0), 0.5, 0.5), ((0, 1, 0), 0.25, 0.5), ((0, -1, 0), 0.75, 0.5), ((0, 0, 1), None, 0.0)],
)
def test_orientation_is_z_up_with_x_at_the_centre(direction: tuple, column: float | None, row: float) -> None:
    height, width = 64, 128
    across = torch.linspace(0.5, width - 0.5, width, dtype=torch.float64) / width
    down = torch.linspace(0.5, height - 0.5, height, dtype=torch.float64) / height
    radiance = torch.stack(
        [across.expand(height, width), down[:, None].expand(height, width), torch.ones(height, width)], -1
    )
    found = EnvironmentMap(radiance).lookup(torch.tensor(direction, dtype=torch.float64))
    if column is not None:
        assert float(found[0]) == pytest.approx(column, abs=1e-12)
    assert float(found[1]) == pytest.approx(row, abs=0.5 / height + 1e-12)


def test_lookup_is_continuous_across_the_seam_and_finite_with_its_gradient_at_the_poles() -> None:
    light = EnvironmentMap(torch.rand(8, 16, 3, dtype=torch.float64))
    angle = torch.tensor([torch.pi - 1e-9, -torch.pi + 1e-9], dtype=torch.float64)
    left, right = light.lookup(torch.stack([angle.cos(), angle.sin(), torch.zeros(2, dtype=torch.float64)], -1))
    torch.testing.assert_close(left, right, atol=1e-7, rtol=0)
    pole = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert torch.isfinite(EnvironmentMap(light.radiance.float()).lookup(pole)).all()


def test_solid_angles_add_up_to_the_sphere() -> None:
    assert float(texel_solid_angles(7, 14).sum() * 14) == pytest.approx(4 * torch.pi, rel=1e-14)
