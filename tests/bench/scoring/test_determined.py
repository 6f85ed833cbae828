"""The criterion of what images determine, on errors of which the answer is known, and a method's mistakes."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy import stats

from bench.fake_method import CPU, FakeSweep, fake_cell
from bench.perfect import Perfect, scene_of, view_with
from radiogs_bench.errors import MethodFailed
from radiogs_bench.scoring.score_maps import truth
from radiogs_bench.scoring.what_images_determine import (
    HALF_A_LEVEL,
    STEPS,
    VIEWS,
    Comparison,
    determined,
    free_rise,
    from_errors,
    shown_by_images,
    spread_over,
    with_free_rise,
)
from radiogs_bench.store.schema import Determined
from radiogs_core.capabilities import QUANTITIES
from radiogs_core.errors import NumericalFailure
from radiogs_core.scene.scene import Scene

BIG = 100 * HALF_A_LEVEL


def parabolas(best: list[float], rise: float = BIG, error: float = 2e-4) -> Determined:
    """Views whose errors are parabolas with the same rise and these best offsets, in steps; a step is 0.1."""
    here, above, below = ([error + rise * (amount - place) ** 2 for place in best] for amount in (0.0, 1.0, -1.0))
    return from_errors(0.5, 0.1, here, above, below)


def test_offset_and_interval_are_the_mean_and_t_interval_of_views_that_count_alike() -> None:
    best = [0.3, -0.1, 0.2, 0.25, -0.05]
    found = parabolas(best)
    assert found["offset"] == pytest.approx(0.1 * np.mean(best))
    assert found["half_width"] == pytest.approx(0.1 * stats.t.ppf(0.975, 4) * stats.sem(best))
    assert found["rise"] == pytest.approx(BIG)
    mean = 2e-4 + BIG * np.mean(np.square(best))
    assert found["error"] == pytest.approx(mean)
    assert found["decibels"] == pytest.approx(10 * math.log10(1 + BIG / mean))
    assert (found["value"], found["step"], found["views"]) == (0.5, 0.1, 5)


def test_views_that_differ_more_in_error_count_more() -> None:
    here, above, below = [0.0, 0.0], [BIG, 3 * BIG], [BIG, BIG]
    found = from_errors(0.0, 1.0, here, above, below)
    # Slopes 0 and BIG, rises BIG and 2 BIG: the sum is lowest at -BIG / (2 x 3 BIG).
    assert found["offset"] == pytest.approx(-1 / 6)


@pytest.mark.parametrize(
    ("best", "rise", "expected"),
    [
        ([0.1, -0.1, 0.05, 0.0], BIG, True),
        ([2.0, -2.0, 1.0, -1.0], BIG, False),  # the views do not agree
        ([1.1, 1.1, 1.1, 1.1], BIG, False),  # they agree on another value
        ([0.7, 0.9, 0.8, 0.8], BIG, True),
        ([0.7, 1.1, 0.8, 1.0], BIG, False),  # not on this one, to within a step
        ([0.1, -0.1, 0.05, 0.0], 0.9 * HALF_A_LEVEL, False),  # no image shows it
        ([0.1, -0.1, 0.05, 0.0], 1.1 * HALF_A_LEVEL, True),
        ([0.1], BIG, False),  # one view has no second to agree with
    ],
)
def test_a_quantity_is_determined_if_images_depend_on_it_and_views_agree(
    best: list[float], rise: float, expected: bool
) -> None:
    assert parabolas(best, rise)["determined"] is expected


def test_an_error_that_falls_on_both_sides_gives_no_interval() -> None:
    found = parabolas([0.0, 0.0, 0.0], -1e-5)
    assert (found["offset"], found["half_width"], found["determined"]) == (None, None, False)
    assert found["decibels"] < 0


def test_an_error_curve_without_a_minimum_gives_no_interval() -> None:
    found = from_errors(0.0, 1.0, [0.0, 0.0, 0.0], [BIG, -1e-6, -1e-6], [BIG, -1e-6, -1e-6])
    assert found["offset"] == pytest.approx(0.0)
    assert (found["half_width"], found["determined"]) == (None, False)


class Changed(Perfect):
    """Shows the truth; each amount of roughness adds ``per_unit`` times it to every pixel of the images."""

    per_unit = 0.2

    @property
    def values(self) -> dict[str, float]:
        return {"roughness": 0.6}

    def varying(self, cameras: Any) -> "Changed":
        self.cameras = cameras
        return self

    def images(self, quantity: str, amount: float) -> list[torch.Tensor]:
        assert quantity == "roughness"
        return [truth(self.view(camera), "image") + self.per_unit * amount for camera in self.cameras]


def scene() -> Scene:
    return scene_of(*(view_with(place, {"image": 3}) for place in range(4)))


def test_the_error_is_per_covered_pixel_of_the_training_images() -> None:
    made = scene()
    found = determined(Changed(made), replace(made, test=()), CPU, "changed")  # test views have no part in it
    assert found.keys() == {"roughness"}
    of_all = (Changed.per_unit * STEPS["roughness"]) ** 2
    # Images differ in all pixels, of which three quarters are covered: what is wrong around the object counts too.
    assert found["roughness"]["rise"] == pytest.approx(of_all * 4 / 3, rel=1e-4)
    assert found["roughness"]["error"] == pytest.approx(0.0, abs=1e-12)
    assert found["roughness"]["determined"]
    assert found["roughness"]["value"] == 0.6


class Painted:
    """Images albedo (a + b roughness) of a stripe of surfaces, three channels, with an albedo and a light for each.

    ``hidden``: the surfaces whose albedo may answer. Answers are in units of ``unit``.
    """

    albedo, unit = 0.5, 0.1

    def __init__(self, made: Scene, hidden: int) -> None:
        self.made, self.hidden = made, hidden
        self.sizes = [(view.camera.height, view.camera.width) for view in made.train]
        self.columns = torch.linspace(0.3, 0.9, self.sizes[0][1], dtype=torch.float64)

    def varying(self, cameras: Any) -> "Painted":
        return self

    @property
    def values(self) -> dict[str, float]:
        return {"roughness": 0.6}

    def nuisance(self, quantity: str) -> "Painted":
        assert quantity == "roughness"
        return self

    @property
    def like(self) -> torch.Tensor:
        return torch.zeros(self.hidden, dtype=torch.float64)

    @property
    def scale(self) -> torch.Tensor:
        return torch.ones_like(self.like)

    def shown(self, rows: torch.Tensor) -> list[torch.Tensor]:
        return [rows[None, :, None].expand(height, -1, 3) for height, _ in self.sizes]

    def change(self, answer: torch.Tensor) -> list[torch.Tensor]:
        spread = torch.zeros_like(self.columns)
        spread[: self.hidden] = self.unit * answer
        return self.shown(spread * self.columns)

    def pull(self, images: Any) -> torch.Tensor:
        along = sum(image.sum((0, 2)) for image in images) * self.columns
        return self.unit * along[: self.hidden]

    def images(self, quantity: Any, amount: Any = 0.0, answer: Any = None) -> list[torch.Tensor]:
        if not isinstance(quantity, str):  # of the nuisance: amount, answer
            quantity, amount, answer = "roughness", quantity, amount
        base = self.shown(self.albedo * self.columns + 0.4 * self.albedo * amount)
        moved = self.change(self.like if answer is None else answer)
        return [one + other for one, other in zip(base, moved, strict=True)]


def dense_rise(painted: Painted, views: Any) -> float:
    """The least squared change by float64 least squares over a dense Jacobian."""
    norm = Comparison.over(views)
    wanted = norm.vector(painted.images("roughness", 0.1)) - norm.vector(painted.images("roughness"))
    if not painted.hidden:
        return float(wanted.square().sum())
    jacobian = torch.stack([norm.vector(painted.change(unit)) for unit in torch.eye(painted.hidden).double()], -1)
    best = torch.linalg.lstsq(jacobian, -wanted[:, None]).solution[:, 0]
    return float((wanted + jacobian @ best).square().sum())


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_free_rise_is_the_rise_that_no_answer_hides(share: float) -> None:
    views = scene().train
    painted = Painted(scene(), int(share * views[0].camera.width))
    shown = [painted.images("roughness", amount) for amount in (0.0, 0.1, -0.1)]
    found, least = free_rise(painted, 0.1, shown, Comparison.over(views)), dense_rise(painted, views)
    assert found == pytest.approx(least, rel=0.02, abs=HALF_A_LEVEL)
    assert found >= 0.999 * least, "a bound from above"
    assert (least < 1e-12) is (share == 1)


def test_a_change_that_everything_else_hides_is_not_determined() -> None:
    """The same images: determined as far as held parameters go, and not if albedo is free."""
    record = parabolas([0.1, -0.1, 0.05, 0.0])
    assert record["determined"]
    assert shown_by_images(record)
    for rise, expected in ((0.9 * HALF_A_LEVEL, False), (1.1 * HALF_A_LEVEL, True)):
        freed = with_free_rise(record, rise)
        assert (freed["rise_free"], freed["rise"]) == (rise, record["rise"])
        assert freed["determined"] is shown_by_images(freed) is expected
    assert shown_by_images(parabolas([2.0, -2.0, 1.0, -1.0])), "views that disagree are no lack of information"


def test_a_method_that_does_not_offer_it_is_not_measured() -> None:
    made = scene()
    assert determined(Perfect(made), made, CPU, "plain") == {}


def test_every_quantity_has_its_step() -> None:
    assert tuple(STEPS) == QUANTITIES


def test_a_request_to_stop_is_noticed() -> None:
    def stop() -> None:
        raise InterruptedError

    made = scene()
    with pytest.raises(InterruptedError):
        determined(Changed(made), made, CPU, "changed", stop)


def test_images_of_wrong_number_or_size_or_not_finite_are_refused() -> None:
    made = scene()

    class Fewer(Changed):
        def images(self, quantity: str, amount: float) -> list[torch.Tensor]:
            return super().images(quantity, amount)[1:]

    class NotFinite(Changed):
        per_unit = math.inf

    with pytest.raises(MethodFailed, match="images of"):
        determined(Fewer(made), made, CPU, "fewer")
    with pytest.raises(NumericalFailure, match="view_0"):
        determined(NotFinite(made), made, CPU, "infinite")


def test_a_result_keeps_the_measurements_of_its_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = parabolas([0.1, 0.2, 0.0])
    asked: list[Any] = []

    def measured(trained: Any, scene: Scene, *further: Any) -> dict[str, Determined]:
        asked.append((scene.name, *further[:2]))
        return {"roughness": record}

    monkeypatch.setattr("radiogs_bench.runs.train.determined", measured)
    sweep, cell = FakeSweep(tmp_path), fake_cell()
    sweep.run([cell])
    result = sweep.store.result(cell.key)
    assert result["determined"] == {"roughness": record}
    assert asked == [("fake", CPU, cell.method)]


def test_views_are_spread_over_the_list() -> None:
    views = [view_with(place, {"image": 3}) for place in range(20)]
    chosen = [view.name for view in spread_over(views, VIEWS)]
    assert chosen == [f"view_{place}" for place in (0, 2, 5, 7, 10, 12, 15, 17)]
    assert spread_over(views[:3], VIEWS) == views[:3]
