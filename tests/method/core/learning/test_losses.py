import torch

from radiogs_core.learning.losses import crossed, mask_entropy, normal_consistency, reconstruction
from radiogs_core.transport.splatting import depth_normals


def test_reconstruction_is_zero_for_equal_images_and_forgives_over_exposure() -> None:
    target = torch.rand(16, 16, 3)
    assert float(reconstruction(target, target)) < 1e-6
    white = torch.ones(16, 16, 3)
    assert float(reconstruction(white * 3, white)) < 1e-6
    assert float(reconstruction(white * 3, white * 0.9)) > 1


def test_several_images_are_compared_as_each_alone() -> None:
    images, target = torch.rand(2, 16, 20, 3, dtype=torch.float64), torch.rand(16, 20, 3, dtype=torch.float64)
    together = reconstruction(images, target, torch.tensor([0.8, 1.0], dtype=torch.float64))
    for found, image, weight in zip(together, images, (0.8, 1.0), strict=True):
        torch.testing.assert_close(found, reconstruction(image, target, weight))


def test_crossed_images_have_no_pull_towards_less_noise() -> None:
    """The noise of images is in proportion to a scale: a single image is best at a smaller scale than the true one."""
    noise = 1 + torch.randn(2, 64, 64, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)

    def slope_at_the_truth(cross: bool) -> float:
        scale = torch.ones(1, dtype=torch.float64, requires_grad=True)
        images = scale * noise[0], scale * noise[1]
        values = [(image - 1).square().mean() for image in (crossed(*images) if cross else images)]
        (slope,) = torch.autograd.grad(sum(values), scale)
        return float(slope)

    assert slope_at_the_truth(False) > 3.5
    assert abs(slope_at_the_truth(True)) < 0.2


def test_crossed_images_keep_their_values() -> None:
    first, second = torch.rand(2, 4, 5, 3)
    assert all(map(torch.equal, crossed(first, second), (first, second)))


def test_depth_normals_of_coinciding_points_are_zero_with_zero_gradient() -> None:
    points = torch.zeros(5, 5, 3, requires_grad=True)
    found = depth_normals(points, torch.ones(3))
    found.sum().backward()
    assert (found == 0).all()
    assert points.grad is not None
    assert (points.grad == 0).all()


def test_normal_consistency_is_the_blended_sum_of_one_minus_cosine() -> None:
    weights = torch.tensor([0.5, 0.3])
    normals = torch.nn.functional.normalize(torch.randn(2, 3), dim=-1)
    depth_normal = torch.nn.functional.normalize(torch.randn(3), dim=-1)
    blended = (weights[:, None] * normals).sum(0)
    expected = (weights * (1 - normals @ depth_normal)).sum()
    found = normal_consistency(blended.expand(1, 1, 3), weights.sum().expand(1, 1), depth_normal.expand(1, 1, 3))
    torch.testing.assert_close(found, expected)


def test_mask_entropy_is_finite_at_hard_coverage_and_smallest_for_agreement() -> None:
    mask = torch.tensor([[0.0, 1.0]])
    assert float(mask_entropy(mask, mask)) < 1e-5
    assert 13 < float(mask_entropy(1 - mask, mask)) < 14
