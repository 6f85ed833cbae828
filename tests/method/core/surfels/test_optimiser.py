from copy import deepcopy

import torch

from radiogs_core.surfels.optimiser import SurfelOptimiser
from radiogs_core.surfels.surfels import Surfels, surfels_at

RATES = dict.fromkeys(
    ("centre", "rotation", "log_scale", "opacity_logit", "sh", "sh_rest", "albedo_logit", "roughness_logit"), 0.01
)


def _optimiser() -> SurfelOptimiser:
    generator = torch.Generator().manual_seed(0)
    surfels = surfels_at(torch.randn(6, 3, generator=generator), torch.ones(6), torch.zeros(6, 3), generator)
    return SurfelOptimiser(surfels, {"light": torch.zeros(2, 4, 3)}, RATES | {"light": 0.1})


def _step(optimiser: SurfelOptimiser) -> None:
    loss = optimiser.tensors["light"].sub(1).square().sum()
    loss = loss + sum(value.square().sum() for value in optimiser.surfels.parameters().values())
    loss.backward()
    optimiser.step()


def test_stepping_equals_torchs_adam_on_the_same_problem() -> None:
    optimiser = _optimiser()
    light = torch.zeros(2, 4, 3, requires_grad=True)
    adam = torch.optim.Adam([light], lr=0.1, eps=1e-15)
    for _ in range(5):
        _step(optimiser)
        adam.zero_grad()
        light.sub(1).square().sum().backward()
        adam.step()
    torch.testing.assert_close(optimiser.tensors["light"], light, rtol=1e-6, atol=0)


def test_a_further_tensor_with_rate_zero_is_held_without_gradient_until_its_rate_rises() -> None:
    optimiser = _optimiser()
    optimiser.set_rate("light", 0.0)
    assert not optimiser.tensors["light"].requires_grad
    _step(optimiser)
    assert not optimiser.tensors["light"].any()
    optimiser.set_rate("light", 0.1)
    _step(optimiser)
    assert optimiser.tensors["light"].all()


def test_moments_follow_their_surfel_and_fresh_surfels_have_none() -> None:
    optimiser = _optimiser()
    for _ in range(3):
        _step(optimiser)
    before = optimiser.state()["moments"]["centre"]["exp_avg"]
    origin = torch.tensor([4, 2, 0, -1])
    optimiser.replace(optimiser.surfels.take(torch.tensor([4, 2, 0, 0])), origin)
    after = optimiser.state()["moments"]["centre"]["exp_avg"]
    assert bool(before[0].any())
    assert torch.equal(after[:3], before[[4, 2, 0]])
    assert (after[3] == 0).all()
    _step(optimiser)
    assert len(optimiser.surfels) == 4


def test_a_restored_optimiser_continues_bit_for_bit() -> None:
    first = _optimiser()
    for _ in range(3):
        _step(first)
    saved = deepcopy(first.state())
    second = _optimiser()
    second.restore(saved)
    for optimiser in (first, second):
        for _ in range(3):
            _step(optimiser)
    for name, value in first.surfels.parameters().items():
        assert torch.equal(value, getattr(second.surfels, name))
    assert isinstance(second.surfels, Surfels)
