"""Central differences that reach the ninth digit: six points, whose error is of the sixth order of the step."""

from collections.abc import Callable

import torch
from torch import Tensor

STENCIL = ((1, 45.0), (2, -9.0), (3, 1.0))
"""Places and weights of f(h) - f(-h); the sum is 60 h f' + O(h^7)."""

Values = dict[str, Tensor]


def slope(value: Callable[[float], float], step: float) -> float:
    """The derivative at zero. Summands are added smallest first."""
    terms = [weight * (value(place * step) - value(-place * step)) for place, weight in reversed(STENCIL)]
    return sum(terms) / (60 * step)


def assert_gradients(
    total: Callable[[Values], float],
    given: Values,
    gradients: Values,
    step: float,
    same_hits: Callable[[Values], object] = lambda values: None,
    directions: int = 8,
) -> None:
    """Each kind of parameter alone, moved in random directions.

    The tolerance is 1e-9 of the largest gradient of its kind, over the root of the number of entries that moved, which
    is how far rounding of that size adds up. ``same_hits`` says what is met: where that changes along the stencil the
    value jumps and no derivative exists, so the direction is drawn anew; more of those than directions is an error.
    """
    met = same_hits(given)
    for name, gradient in gradients.items():
        drawn = 0
        tested = 0
        while tested < directions:
            drawn += 1
            assert drawn <= 2 * directions, f"{name}: hits change in most directions"
            shift = torch.randn_like(given[name])

            def moved(amount: float, name: str = name, shift: Tensor = shift) -> Values:
                return given | {name: given[name] + amount * shift}

            if any(same_hits(moved(sign * place * step)) != met for place, _ in STENCIL for sign in (1, -1)):
                continue
            tested += 1
            numeric = slope(lambda amount, moved=moved: total(moved(amount)), step)  # type: ignore[misc]
            analytic = float((gradient * shift).sum())
            tolerance = 1e-9 * float(gradient.abs().max()) * max(1.0, gradient.numel() ** 0.5)
            assert abs(numeric - analytic) <= tolerance, f"{name}: {numeric} against {analytic}"
