from itertools import product

import pytest
import torch

from radiogs_core.kernels.adam import BLOCK, Adam

BETAS, GUARD = (0.9, 0.999), 1e-15


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_steps_follow_the_published_recurrence_of_every_tensor_at_its_own_rate(dtype: torch.dtype) -> None:
    """Kingma and Ba, Algorithm 1, in float64, over tensors that fill blocks in part, and one that joins later."""
    generator = torch.Generator().manual_seed(0)
    shapes = {"one": (1,), "block": (BLOCK,), "more": (BLOCK + 3, 3), "late": (7, 2)}
    tensors = {name: torch.randn(shape, generator=generator, dtype=dtype) for name, shape in shapes.items()}
    rates = {name: 0.1 * (1 + place) for place, name in enumerate(shapes)}
    expected = {name: value.double() for name, value in tensors.items()}
    moments = {name: (0, *(torch.zeros_like(value) for _ in range(2))) for name, value in expected.items()}
    adam = Adam(GUARD)
    for step, (name, value) in product(range(4), tensors.items()):
        if name == "late" and step < 2:
            continue
        gradient = torch.randn(value.shape, generator=generator, dtype=dtype) * 10.0 ** (-2 * step)
        value.grad = gradient.clone()
        if name == "late":
            adam.step(tensors, rates)
        elif name == "more" and step < 2:
            adam.step({each: tensors[each] for each in ("one", "block", "more")}, rates)
        done, mean, square = moments[name]
        mean = BETAS[0] * mean + (1 - BETAS[0]) * gradient.double()
        square = BETAS[1] * square + (1 - BETAS[1]) * gradient.double() ** 2
        moments[name] = (done + 1, mean, square)
        mean, square = mean / (1 - BETAS[0] ** (done + 1)), square / (1 - BETAS[1] ** (done + 1))
        expected[name] -= rates[name] * mean / (square.sqrt() + GUARD)
    for name, value in tensors.items():
        assert value.grad is None
        torch.testing.assert_close(
            value.double(), expected[name], rtol=0, atol=2e-5 if dtype == torch.float32 else 1e-12
        )
