import torch

from radiogs_core.scene.camera import Camera


def _camera() -> Camera:
    rotation = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64)).Q
    rotation = rotation * torch.linalg.det(rotation)
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3], matrix[:3, 3] = rotation, torch.randn(3, dtype=torch.float64)
    return Camera(matrix, 50.0, 45.0, 17.0, 11.5, 33, 21)


def test_a_point_along_a_pixels_ray_projects_to_the_pixels_centre_at_its_depth() -> None:
    camera = _camera()
    points = camera.centre + 2.5 * camera.ray_directions()
    pixel, depth, in_frame = camera.project(points.reshape(-1, 3))
    rows, columns = torch.meshgrid(torch.arange(21), torch.arange(33), indexing="ij")
    expected = torch.stack([columns, rows], -1).reshape(-1, 2).double() + 0.5
    torch.testing.assert_close(pixel, expected)
    torch.testing.assert_close(depth, torch.full_like(depth, 2.5))
    assert in_frame.all()


def test_the_forward_axis_is_seen_at_the_principal_point() -> None:
    camera = _camera()
    pixel, _, _ = camera.project((camera.centre + camera.axes[:, 2])[None])
    torch.testing.assert_close(pixel[0], torch.tensor([17.0, 11.5], dtype=torch.float64))


def test_points_beside_the_image_and_behind_the_camera_are_not_in_the_frame() -> None:
    camera = _camera()
    pixel = torch.tensor([[0.1, 0.1], [-0.1, 4.0], [33.1, 4.0], [7.0, -0.1], [7.0, 21.5], [7.5, 4.5]]).double()
    slope = (pixel - torch.tensor([17.0, 11.5])) / torch.tensor([50.0, 45.0])
    local = torch.cat([slope, torch.ones(6, 1)], 1) * torch.tensor([1, 1, 1, 1, 1, -1])[:, None]
    found = camera.project(camera.centre + local @ camera.axes.T)
    torch.testing.assert_close(found[0], pixel)
    assert found[2].tolist() == [True, False, False, False, False, False]
