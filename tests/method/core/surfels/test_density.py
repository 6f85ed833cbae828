"""Density control clones, splits and prunes by the positional gradient, when it is due."""

from collections.abc import Iterable
from dataclasses import replace

import pytest
import torch

from radiogs_core.scene.camera import Camera
from radiogs_core.surfels.density import AdaptiveDensity, AdaptiveDensityControl, OpacityResets
from radiogs_core.surfels.surfels import Surfels, inverse_sigmoid, surfels_at

RULES = AdaptiveDensity()


def four_surfels() -> Surfels:
    """Small with a large gradient, large with one, faint, and one with hardly any gradient."""
    generator = torch.Generator().manual_seed(0)
    surfels = surfels_at(
        torch.arange(12.0).view(4, 3), torch.tensor([0.005, 0.05, 0.05, 0.05]), torch.zeros(4, 3), generator
    )
    surfels.opacity_logit = torch.tensor([1.0, 1.0, inverse_sigmoid(0.01), 1.0])
    return surfels


def all_show(surfels: Surfels) -> torch.Tensor:
    return torch.ones(len(surfels))


def control(gradient: list[float], maximum: int = 100, rules: AdaptiveDensity = RULES) -> AdaptiveDensityControl:
    made = AdaptiveDensityControl(rules, 10, maximum, 1.0, four_surfels(), all_show)
    made.total, made.views = torch.tensor(gradient, dtype=torch.float32), torch.ones(4)
    return made


def changed(surfels: Surfels, by: AdaptiveDensityControl) -> tuple[Surfels, torch.Tensor]:
    return by.act(surfels, 20, 100, torch.Generator().manual_seed(0))


def test_small_ones_are_cloned_large_ones_split_and_faint_ones_pruned() -> None:
    surfels = four_surfels()
    after, origin = changed(surfels, control([1, 1, 1, 1e-9]))
    assert origin.tolist() == [0, 3, -1, -1, -1]
    torch.testing.assert_close(after.centre[2], surfels.centre[0])
    torch.testing.assert_close(after.scale[3:], surfels.scale[1].expand(2, 2) / RULES.split_shrink)
    in_plane = (after.centre[3:] - surfels.centre[1]) @ surfels.frame[1, :, 2]
    torch.testing.assert_close(in_plane, torch.zeros(2), atol=1e-6, rtol=0)


def test_beyond_the_cameras_size_is_judged_as_it_appears() -> None:
    """Where space is stretched, what is cloned is as much larger, and nothing is pruned for its size."""
    surfels = four_surfels()
    surfels.log_scale = torch.tensor([0.05, 0.05, 0.5, 5.0]).log()[:, None].repeat(1, 2)
    surfels.opacity_logit = torch.ones(4)
    plain = control([1, 1, 1e-9, 1e-9])
    assert changed(surfels, plain)[1].tolist() == [-1, -1, -1, -1]  # two split, two pruned
    far = control([1, 1, 1e-9, 1e-9])
    far.stretch = lambda _: torch.tensor([1.0, 10.0, 1.0, 10.0])
    assert changed(surfels, far)[1].tolist() == [1, 3, -1, -1, -1]  # kept and cloned, kept; one split, one pruned


def test_the_ceiling_admits_the_largest_gradients_only() -> None:
    after, origin = changed(four_surfels(), control([1, 2, 0, 1e-9], maximum=4))
    assert len(after) == 4
    assert origin.tolist() == [0, 3, -1, -1]


def test_a_surfel_that_no_view_saw_is_pruned() -> None:
    unseen = [1e-9, 0, 0, 1e-9]
    assert changed(four_surfels(), control(unseen))[1].tolist() == [0, 3]
    kept = changed(four_surfels(), control(unseen, rules=replace(RULES, prune_unseen=False)))
    assert kept[1].tolist() == [0, 1, 3]  # the third is faint


@pytest.mark.parametrize(("iteration", "stay"), [(20, [0, 3, -1]), (25, [0, 2, 3]), (30, [0, 3, -1, -1, -1])])
def test_surfels_that_hardly_show_are_pruned_where_that_is_due(iteration: int, stay: list[int]) -> None:
    by = control([1, 1, 1, 1e-9], rules=replace(RULES, hidden_at=(0.2, 0.25)))
    by.contribution = lambda _: torch.tensor([0.11, 0.09, 0.11, 5.0])
    found = by.act(four_surfels(), iteration, 100, torch.Generator().manual_seed(0))
    assert found[1].tolist() == stay
    assert len(by.total) == len(found[0]) == len(found[1])


def test_remaining_surfels_keep_their_statistics_if_none_are_added() -> None:
    by = control([1, 2, 3, 4], rules=replace(RULES, hidden_at=(1.0,)))
    by.contribution = lambda _: torch.tensor([1.0, 0.0, 1.0, 1.0])
    by.act(four_surfels(), 100, 100, torch.Generator())
    assert by.total.tolist() == [1, 3, 4]


@pytest.mark.parametrize(
    ("rules", "origin"),
    [
        (replace(RULES, gradient_threshold=2.0), [0, 1, 3]),
        (replace(RULES, clone_scale=0.1), [0, 1, 3, -1, -1]),
        (replace(RULES, largest_scale=0.01), [0, -1]),
        (replace(RULES, opacity_floor=0.0), [0, 3, -1, -1, -1, -1, -1]),
    ],
)
def test_every_threshold_comes_from_the_rules(rules: AdaptiveDensity, origin: list[int]) -> None:
    assert changed(four_surfels(), control([1, 1, 1, 1e-9], rules=rules))[1].tolist() == origin


@pytest.mark.parametrize(
    ("iteration", "due"),
    [(0, False), (1, False), (10, True), (15, False), (60, True), (62, False), (70, False), (100, True)],
)
def test_rounds_are_due_at_the_interval_between_start_and_end(iteration: int, due: bool) -> None:
    assert control([1, 1, 1, 1]).due(iteration, 100) == due


def test_hardly_shown_surfels_are_looked_for_between_rounds_too() -> None:
    by = control([1, 1, 1, 1], rules=replace(RULES, hidden_at=(0.25,)))
    assert [iteration for iteration in range(21, 30) if by.due(iteration, 100)] == [25]


PUBLISHED = OpacityResets(lower_every=3_000 / 40_000, raise_every=1_000 / 40_000)


def resets(steps: Iterable[int], iterations: int, of: OpacityResets = PUBLISHED) -> tuple[list[int], list[int]]:
    """The steps among these after which opacities are lowered, and the steps after which they are raised."""
    among = list(steps)
    return [each for each in among if of.lowers(each, iterations)], [
        each for each in among if of.raises(each, iterations)
    ]


def test_opacities_are_reset_at_the_published_steps_of_a_stage_as_long_as_the_papers() -> None:
    thousands = range(1_000, 40_001, 1_000)
    steps = [thousand + beside for thousand in (0, *thousands) for beside in (-1, 0, 1, 500)]
    lowered, raised = resets(steps, 40_000)
    assert lowered == list(range(3_000, 40_001, 3_000))
    assert raised == [each for each in thousands if each % 3_000]
    assert resets(steps, 40_000, OpacityResets()) == ([], [])
    assert resets(steps, 40_000, replace(PUBLISHED, lower_every=0.0)) == ([], list(thousands))


def test_in_a_short_stage_opacities_have_time_to_recover_between_resets() -> None:
    lowered, raised = resets(range(2_001), 2_000)
    assert lowered == [400, 800, 1_200, 1_600, 2_000]
    assert raised[:4] == [133, 267, 533, 667]  # thirds of 400, as those of 3,000 are 1,000
    assert resets(range(500), 2_000, replace(PUBLISHED, recovery=1))[0][:3] == [150, 300, 450]


@pytest.mark.parametrize("iterations", [2_000, 5_500, 7_777])
def test_no_reset_raises_opacities_again_that_were_lowered_just_before(iterations: int) -> None:
    """A third of an interval lies between them, whatever both are rounded to."""
    lowered, raised = resets(range(2_500), iterations)
    interval = max(400, 0.075 * iterations)
    assert not [(low, high) for low in lowered for high in raised if abs(high - low) < interval / 3 - 1]


def test_resets_act_between_start_and_end_and_on_the_opacities_of_a_round() -> None:
    every = OpacityResets(lower_every=0.3, raise_every=0.1, recovery=1)
    by = control([1, 1, 1, 1e-9], rules=replace(RULES, start=0.0, end=0.7, hidden_at=(), resets=every))
    by.interval = 20
    assert [each for each in range(1, 100) if by.due(each, 100)] == [10, 20, 30, 40, 50, 60]
    surfels = four_surfels()
    raised, origin = by.act(surfels, 10, 100, torch.Generator())
    assert origin.tolist() == [0, 1, 2, 3]
    torch.testing.assert_close(raised.opacity, torch.full((4,), 0.9))
    lowered, _ = by.act(replace(surfels, opacity_logit=torch.tensor([1.0, -9.0, 1.0, 1.0])), 30, 100, torch.Generator())
    torch.testing.assert_close(lowered.opacity, torch.tensor([0.01, 1.2339e-4, 0.01, 0.01]))
    both, origin = by.act(surfels, 60, 100, torch.Generator().manual_seed(0))
    assert origin.tolist() == [0, 3, -1, -1, -1]
    torch.testing.assert_close(both.opacity, torch.full((5,), 0.01))


def test_statistics_reset_after_a_round_and_resume_before_it() -> None:
    first = control([1, 1, 1, 1e-9])
    resumed = AdaptiveDensityControl(RULES, 10, 100, 1.0, four_surfels(), all_show)
    resumed.restore(first.state())
    assert changed(four_surfels(), resumed)[1].tolist() == changed(four_surfels(), first)[1].tolist()
    assert len(first.total) == 5
    assert not first.total.any()


def test_the_positional_gradient_is_per_shift_of_half_an_image() -> None:
    camera = Camera(torch.eye(4, dtype=torch.float64), 40.0, 40.0, 32.0, 32.0, 64, 64)
    centre = torch.tensor([[0.3, -0.2, 5.0]], dtype=torch.float64)
    weight = torch.tensor([2.0, 3.0], dtype=torch.float64)

    def loss(half_images: torch.Tensor) -> torch.Tensor:
        # a loss that is linear in the position on the screen, in half-images
        return (half_images * weight).sum()

    centre.requires_grad_()
    on_screen = centre[0, :2] / centre[0, 2] * 40.0 / 32.0
    loss(on_screen).backward()
    assert centre.grad is not None
    found = AdaptiveDensityControl(RULES, 10, 100, 1.0, four_surfels().take(torch.tensor([0])), all_show)
    found.observe(camera, centre.detach(), centre.grad, torch.tensor([True]))
    assert float(found.total) == pytest.approx(float(weight.norm()))
    assert float(found.views) == 1
