"""The released formulas that a new implementation must not inherit, by hazard; ``test_hazards`` holds ours to more."""

import math

import torch
from torch import Tensor


def ggx_distribution(half_cosine: Tensor, roughness: float) -> Tensor:
    """H1, H2: D with q = NoH^2 (a^2 - 1) + 1, whose product pi q^2 is clamped to [1e-6, 4 pi]."""
    alpha_squared = roughness**4
    q = half_cosine.square() * (alpha_squared - 1) + 1
    return alpha_squared / (math.pi * q * q).clamp(1e-6, 4 * math.pi)


def ggx_without_clamp(half_cosine: Tensor, roughness: float) -> Tensor:
    """H2 alone: the same form, whose subtraction loses the digits of a sharp lobe."""
    alpha_squared = roughness**4
    q = half_cosine.square() * (alpha_squared - 1) + 1
    return alpha_squared / (math.pi * q * q)


def hemisphere_heights(samples: int) -> Tensor:
    """H3: n.w of the set, z_i = max(1 - 2 i / (2 S - 1), sin 10 degrees); every sample weighs 2 pi / S."""
    place = torch.arange(samples, dtype=torch.float64)
    return (1 - 2 * place / (2 * samples - 1)).clamp(min=math.sin(math.radians(10)))


def mirrored(normal: Tensor, outgoing: Tensor) -> Tensor:
    """H4: v - 2 (n.v) n, though v points to the camera."""
    return outgoing - 2 * (normal * outgoing).sum(-1, keepdim=True) * normal


def minimal_rotation(normal: Tensor) -> Tensor:
    """H5: the smallest rotation from +z to n, 1 + [w] + [w]^2 / (1 + n_z), with 1 + n_z clamped at 1e-7."""
    x, y, z = normal.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [zero, zero, x, zero, zero, y, -x, -y, zero]
    cross = torch.stack(rows, -1).unflatten(-1, (3, 3))
    return torch.eye(3, dtype=normal.dtype) + cross + cross @ cross / (1 + z).clamp(min=1e-7)[..., None, None]


def hit_distance(normal: Tensor, towards: Tensor, direction: Tensor) -> Tensor:
    """H6: (n.(p - o)) (n.d) / max(1e-6, (n.d)^2)."""
    slope = (normal * direction).sum(-1)
    return (normal * towards).sum(-1) * slope / slope.square().clamp(min=1e-6)


def hit_distance_slope(normal: Tensor, direction: Tensor) -> Tensor:
    """H6: what its backward pass takes for the derivative by n.(p - o): 1 / (n.d), without the clamp."""
    return 1 / (normal * direction).sum(-1)


FORWARD_T_MIN = torch.finfo(torch.float32).eps
"""H7: where the forward pass begins to look for hits."""

BACKWARD_T_MIN = 0.0
"""H7: where the backward pass does, on the same ray."""


def support_radius(opacity: Tensor) -> Tensor:
    """H8: sqrt(2 ln(o / alpha_min)), alpha_min = 1/255."""
    return (2 * (opacity * 255).log()).sqrt()


NEAR, FAR, BACK_FACE = 0.2, 100.0, -0.01
"""H9: constants in world units."""


def takes_part(point: Tensor, normal: Tensor) -> Tensor:
    """H9: which surfels (camera axes) a view keeps: p_z > 0.2 and p.n <= -0.01, of the unscaled p."""
    return (point[..., 2] > NEAR) & ((point * normal).sum(-1) <= BACK_FACE)


def expected_depth(blended: Tensor, alpha: Tensor) -> Tensor:
    """H10: sum w z over alpha, then ``nan_to_num``."""
    return torch.nan_to_num(blended / alpha, 0.0, 0.0)


def saturated(colour: Tensor, alpha: Tensor) -> tuple[Tensor, Tensor]:
    """H11: from 97 % on, colour is divided by alpha and alpha is 1; the division happens in both branches."""
    solid = alpha >= 0.97
    return torch.where(solid[..., None], colour / alpha[..., None], colour), torch.where(solid, 1.0, alpha)


def mean_psnr(values: list[float], start: int) -> float:
    """H12: frames before ``start`` are skipped in the sum and counted in the mean."""
    return sum(values[start:]) / len(values)


def facing_cosine(normal: Tensor, outgoing: Tensor) -> Tensor:
    """H13: the normal is turned by sign(n.v), which is 0 for a grazing view, and the cosine clamped in place."""
    turned = normal * (normal * outgoing).sum(-1, keepdim=True).sign()
    return (turned * outgoing).sum(-1).clamp_(1e-6, 1)
