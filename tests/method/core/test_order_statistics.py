import numpy as np
import pytest
import torch

from radiogs_core.order_statistics import quantile

MORE_THAN_TORCH_TAKES = 2**24
"""``torch.quantile`` refuses more entries than these."""


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.99, 1.0])
def test_it_is_the_quantile_of_all_parts_joined(share: float) -> None:
    generator = torch.Generator().manual_seed(0)
    parts = [torch.randn(count, generator=generator) * 10.0**power for count, power in ((700, -3), (1, 0), (44, 6))]
    parts.append(torch.tensor([0.0, -0.0, 1.5, 1.5]))
    expected = np.quantile(torch.cat(parts).double().numpy(), share)
    assert quantile(lambda: parts, share) == pytest.approx(expected, rel=1e-12, abs=1e-45)


def test_a_quantile_of_no_values_is_none() -> None:
    assert quantile(lambda: [torch.zeros(0)], 0.5) is None


@pytest.mark.slow
def test_it_takes_more_values_than_torch_does() -> None:
    values = torch.arange(1000.0).repeat(MORE_THAN_TORCH_TAKES // 1000 + 1)
    assert values.numel() > MORE_THAN_TORCH_TAKES
    with pytest.raises(RuntimeError, match="too large"):
        torch.quantile(values, 0.9)
    # Its place, 0.9 (n - 1), is a tenth of the way from the last 899 to the first 900.
    assert quantile(lambda: [values], 0.9) == pytest.approx(899.1, abs=1e-6)
