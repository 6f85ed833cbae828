import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.starting_points import project


def _camera() -> Camera:
    rotation = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64)).Q
    rotation = rotation * torch.linalg.det(rotation)
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3], matrix[:3, 3] = rotation, torch.randn(3, dtype=torch.float64)
    return Camera(matrix, 50.0, 45.0, 17.0, 11.5, 33, 21)


def test_a_point_along_a_pixels_ray_projects_to_the_pixels_centre_at_its_depth() -> None:
    camera = _camera()
    points = camera.centre + 2.5 * camera.ray_directions()
    pixel, depth = project(points.reshape(-1, 3), camera)
    rows, columns = torch.meshgrid(torch.arange(21), torch.arange(33), indexing="ij")
    expected = torch.stack([columns, rows], -1).reshape(-1, 2).double() + 0.5
    torch.testing.assert_close(pixel, expected)
    torch.testing.assert_close(depth, torch.full_like(depth, 2.5))


def test_the_forward_axis_is_seen_at_the_principal_point() -> None:
    camera = _camera()
    pixel, _ = project((camera.centre + camera.axes[:, 2])[None], camera)
    torch.testing.assert_close(pixel[0], torch.tensor([17.0, 11.5], dtype=torch.float64))
