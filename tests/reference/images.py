"""The image terms of losses as dense float64 PyTorch, written from the formulas only; gradients by autograd."""

import torch
from torch import Tensor
from torch.nn.functional import conv2d, max_pool2d, pad


def compared(images: Tensor, target: Tensor) -> Tensor:
    """[images, 3]: mean absolute difference, mean SSIM by a window of 11 x 11 taps, zero beyond the border, and mean
    squared difference."""
    place = torch.arange(11, dtype=target.dtype) - 5
    weight = torch.exp(-(place[:, None] ** 2 + place**2) / (2 * 1.5**2))
    weight = weight / weight.sum()

    def mean(values: Tensor) -> Tensor:
        return conv2d(values.permute(2, 0, 1)[:, None], weight[None, None], padding=5)[:, 0].permute(1, 2, 0)

    found = []
    for image in images:
        x, y = torch.where(target >= 1, image.clamp(max=1), image), target
        xx, yy, xy = mean(x * x) - mean(x) ** 2, mean(y * y) - mean(y) ** 2, mean(x * y) - mean(x) * mean(y)
        luminance = (2 * mean(x) * mean(y) + 0.01**2) / (mean(x) ** 2 + mean(y) ** 2 + 0.01**2)
        contrast = (2 * xy + 0.03**2) / (xx + yy + 0.03**2)
        found.append(torch.stack([(x - y).abs().mean(), (luminance * contrast).mean(), (x - y).square().mean()]))
    return torch.stack(found)


def sobel(image: Tensor) -> Tensor:
    """[2, height, width, channels]: slopes along x and y, a pixel; the border goes on."""
    along = torch.tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]], dtype=image.dtype) / 8
    padded = pad(image.permute(2, 0, 1)[:, None], (1, 1, 1, 1), mode="replicate")
    return torch.stack([conv2d(padded, taps[None, None])[:, 0].permute(1, 2, 0) for taps in (along, along.T)])


def edge_allowance(guide: Tensor, sharpness: float, mask: Tensor | None) -> Tensor:
    """[2, height, width, 3]: exp(-sharpness |slope|), zero where one of the nine pixels is less than half covered."""
    found = torch.exp(-sharpness * sobel(guide).abs())
    if mask is None:
        return found
    return found * (1 - max_pool2d((mask < 0.5).to(guide)[None, None], 3, 1, 1)[0, 0])[..., None]


def edge_aware_smoothness(data: Tensor, allowance: Tensor) -> Tensor:
    """Mean over pixels and colours of the sum over x and y."""
    return (sobel(data).abs() * allowance).sum(0).mean()


def one_sided_normals(points: Tensor, depth: Tensor, solid: Tensor, toward: Tensor) -> Tensor:
    """[height, width, 3], by loops over the pixels."""
    height, width = depth.shape
    rows = [torch.zeros(width, 3, dtype=points.dtype) for _ in range(height)]
    for row in range(height):
        normals = [torch.zeros(3, dtype=points.dtype)] * width
        for column in range(width):
            steps = [_step(points, depth, solid, row, column, *axis) for axis in ((0, 1), (1, 0))]
            if not solid[row, column] or any(step is None for step in steps):
                continue
            across, down = steps
            assert across is not None
            normal = torch.linalg.cross(down, across)
            normal = normal / normal.norm()
            normals[column] = -normal if normal @ (toward - points[row, column]) < 0 else normal
        rows[row] = torch.stack(normals)
    return torch.stack(rows)


def central_normals(points: Tensor, depth: Tensor, solid: Tensor, toward: Tensor) -> Tensor:
    """[height, width, 3], by loops over the pixels; zero at the border and beside a pixel without surface."""
    height, width = depth.shape
    normals = torch.zeros_like(points)
    for row in range(1, height - 1):
        for column in range(1, width - 1):
            if not bool(solid[row - 1 : row + 2, column - 1 : column + 2].all()):
                continue
            across = points[row, column + 1] - points[row, column - 1]
            down = points[row + 1, column] - points[row - 1, column]
            normal = torch.linalg.cross(down, across)
            normal = normal / normal.norm()
            facing = -normal if normal @ (toward - points[row, column]) < 0 else normal
            normals = normals.index_put((torch.tensor(row), torch.tensor(column)), facing)
    return normals


def _step(points: Tensor, depth: Tensor, solid: Tensor, row: int, column: int, down: int, right: int) -> Tensor | None:
    """From a pixel's point to the next along an axis, where inverse depth bends less; None where there is none."""

    def there(count: int) -> bool:
        i, j = row + count * down, column + count * right
        return 0 <= i < depth.shape[0] and 0 <= j < depth.shape[1] and bool(solid[i, j])

    def inverse(count: int) -> float:
        return 1 / float(depth.detach()[row + count * down, column + count * right])

    bends = {}
    for sign in (1, -1):
        if there(sign):
            bends[sign] = abs(inverse(0) - 2 * inverse(sign) + inverse(2 * sign)) if there(2 * sign) else 1e6
    if not bends:
        return None
    side = min(bends, key=lambda sign: (bends[sign], -sign))
    return side * (points[row + side * down, column + side * right] - points[row, column])


def displayed(blended: Tensor, alpha: Tensor, straight: bool, background: float) -> Tensor:
    """Linear radiance that coverage was multiplied into, as display sRGB over a grey; pixel by pixel."""

    def encoded(linear: Tensor) -> Tensor:
        if linear <= 0.0031308:
            return 12.92 * linear
        return 1.055 * linear ** (1 / 2.4) - 0.055

    images = []
    for image in blended:
        pixels = []
        for colour, coverage in zip(image.reshape(-1, 3), alpha.reshape(-1), strict=True):
            behind = background * (1 - coverage)
            if straight and coverage == 0:
                pixels.append((0 * colour.sum() + behind).expand(3))
            elif straight:
                pixels.append(torch.stack([coverage * encoded(value / coverage) + behind for value in colour]))
            else:
                pixels.append(torch.stack([encoded(value) + behind for value in colour]))
        images.append(torch.stack(pixels).view(image.shape))
    return torch.stack(images)
