"""Values and gradients of two functions, and central differences that reach the ninth digit.

A difference has six points, and its error is of the sixth order of the step.
"""

from collections.abc import Callable, Sequence

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
    """Compare gradients of each kind of parameter with central differences in random directions.

    The tolerance is 1e-9 of the largest gradient of its kind, over the root of the number of entries that moved, which
    is how far rounding of that size adds up. ``same_hits`` lists the hits: if they change along the stencil, the value
    jumps and no derivative exists, so another direction is drawn; more redraws than directions are an error.
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


def assert_same_with_gradients(
    ours: Callable[..., Tensor | tuple[Tensor, ...]],
    theirs: Callable[..., Tensor | tuple[Tensor, ...]],
    *given: Tensor,
    values: float = 1e-11,
    gradients: float = 1e-9,
) -> None:
    """Two functions of the same tensors have the same outputs and, for random pulls, the same gradients to each tensor.

    ``values`` and ``gradients`` are relative and absolute tolerances. The second function runs on the CPU; an output or
    a tensor on which it does not depend has no gradient by the first one either.
    """
    mine, other = [value.clone().requires_grad_() for value in given], [value.cpu().clone() for value in given]
    found, expected = ours(*mine), theirs(*(value.requires_grad_() for value in other))
    found, expected = ((each,) if isinstance(each, Tensor) else each for each in (found, expected))
    total = reference = torch.zeros((), dtype=expected[0].dtype, device="cpu")
    for one, value in zip(found, expected, strict=True):
        torch.testing.assert_close(one.cpu(), value, rtol=values, atol=values)
        pull = torch.randn(value.shape, dtype=value.dtype, device="cpu")
        total, reference = total + (one.cpu() * pull).sum(), reference + (value * pull).sum()
    total.backward()
    if reference.requires_grad:
        reference.backward()
    for one, leaf in zip(mine, other, strict=True):
        zero = torch.zeros_like(leaf)
        slope, wanted = (zero if each.grad is None else each.grad.cpu() for each in (one, leaf))
        torch.testing.assert_close(slope, wanted, rtol=gradients, atol=gradients)


def gradients_of(
    function: Callable[[Values], Sequence[Tensor]], given: Values, pulls: Sequence[Tensor], learnt: Sequence[str]
) -> Values:
    """The gradients to the tensors ``learnt`` of the function's outputs times ``pulls``, all added up."""
    leaves = {name: value.clone().requires_grad_(name in learnt) for name, value in given.items()}
    torch.stack([(out * pull).sum() for out, pull in zip(function(leaves), pulls, strict=True)]).sum().backward()
    return {name: leaves[name].grad for name in learnt}  # type: ignore[misc]


def assert_same_slopes(ours: Values, theirs: Values) -> None:
    """Gradients differ by at most 1e-9 of the largest of their kind, and no kind is zero."""
    for name, expected in theirs.items():
        if expected.numel():
            assert expected.abs().max() > 0, f"no gradient to {name}"
            assert (ours[name] - expected).abs().max() <= 1e-9 * expected.abs().max(), name
