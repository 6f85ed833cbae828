"""The trail of a training, and its first steps: the same if interrupted, and nothing that is learnt changes."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import torch

from bench.fake_method import CPU, SCENE, FakeSweep, FakeTrained, evaluate, fake_cell, method
from radiogs_bench.errors import Interrupted
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.scene_checksum import checksum_now
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.runs.training_curves import FIRST_STEPS, FirstSteps, Trail, milestones
from radiogs_bench.store.schema import FirstStep, Result
from radiogs_bench.suites.experiment import COST
from radiogs_core.contract import Run
from radiogs_core.instruments import count
from radiogs_core.on_surfels.fit_geometry import FitGeometry, Shading
from radiogs_core.on_surfels.settings import GEOMETRY_PRESETS, SurfelVariant
from scenes import sphere_scene

CELL = fake_cell(experiment=COST)


def scored(model: FakeTrained) -> dict[str, float]:
    count(blended_pairs=1000)
    return {"nvs/psnr": float(4 * model.place.sum())}


def run_scored(bench: Bench) -> None:
    """Run the cell, and score its model along the way."""
    train_and_score(bench, CELL, SCENE, along_the_way=scored, score=evaluate)  # type: ignore[arg-type]


def stored(sweep: FakeSweep) -> Result:
    result = sweep.store.result(CELL.key)
    assert result is not None
    return result


def test_steps_of_a_trail_grow_by_a_fifth_and_end_with_the_stage() -> None:
    for iterations in (1, 2, 20, 800, 20_000):
        steps = sorted(milestones(iterations))
        assert steps[0] == 1
        assert steps[-1] == iterations
        assert all(after <= max(before + 1, 1.25 * before) for before, after in itertools.pairwise(steps))
        assert len(steps) <= 62


def test_a_point_holds_the_mean_over_the_steps_since_the_one_before() -> None:
    trail, given = Trail(40, [], {}, scored=False), {}
    for step in range(1, 41):
        given[step] = {"always": step**1.5, **({"late": 2.0 * step} if step > 30 else {})}
        trail.add(given[step])
        if trail.due(step):
            trail.close(step, 0.0, {})
            trail = Trail(40, trail.points, trail.since, scored=False)
    before = 0
    for point in trail.points:
        steps = range(before + 1, point["iteration"] + 1)
        assert point["losses"]["always"] == pytest.approx(sum(given[step]["always"] for step in steps) / len(steps))
        late = [2.0 * step for step in steps if step > 30]
        assert point["losses"].get("late") == (pytest.approx(sum(late) / len(late)) if late else None)
        before = point["iteration"]
    assert before == 40


def test_interrupting_after_every_step_gives_the_same_trail(tmp_path: Path) -> None:
    whole, stopped = FakeSweep(tmp_path / "whole"), FakeSweep(tmp_path / "stopped")
    run_scored(whole.bench)
    stops = 0
    while stopped.store.result(CELL.key) is None:
        interruption = Interruption()
        interruption.requested = stops < 6
        try:
            run_scored(Bench(stopped.store, CPU, LogProgress(), interruption, method, checksum_now))
        except Interrupted:
            stops += 1
    assert stops == 6
    for stage, points in stored(whole)["trail"].items():
        resumed = stored(stopped)["trail"][stage]
        assert [{**point, "seconds": 0} for point in points] == [{**point, "seconds": 0} for point in resumed]
        assert [point["iteration"] for point in points] == [1, 2, 3]


def test_scoring_along_the_way_changes_neither_the_result_nor_the_work(tmp_path: Path) -> None:
    watched, alone = FakeSweep(tmp_path / "watched"), FakeSweep(tmp_path / "alone")
    run_scored(watched.bench)
    train_and_score(alone.bench, CELL, SCENE, score=evaluate)  # type: ignore[arg-type]
    assert stored(watched)["metrics"] == stored(alone)["metrics"]
    assert stored(watched)["work"] == stored(alone)["work"]
    assert stored(watched)["losses"] == stored(alone)["losses"]
    last = stored(watched)["trail"]["invert"][-1]
    assert last["metrics"] == {"nvs/psnr": pytest.approx(stored(watched)["metrics"]["nvs/psnr"]["value"])}
    assert all(point["metrics"] == {} for point in stored(watched)["trail"]["initialise"])
    assert all(point["metrics"] == {} for points in stored(alone)["trail"].values() for point in points)


def test_a_model_scored_along_the_way_is_another_product_but_shares_stage_one() -> None:
    plain = fake_cell()
    assert plain.stages[0].key == CELL.stages[0].key
    assert plain.training_key != CELL.training_key
    assert fake_cell(protocol="irgs").training_key == plain.training_key
    assert fake_cell(protocol="irgs", experiment=COST).training_key != CELL.training_key


RATE = 0.1


class Descent:
    """Gradient descent on the sum of squares of three numbers."""

    def __init__(self) -> None:
        self.iteration, self.iterations = 0, 20
        self.optimiser = self
        self.tensors = {"place": torch.tensor([1.0, 2.0, 2.0], requires_grad=True), "held": torch.ones(2)}

    def step(self) -> Mapping[str, float]:
        loss = self.tensors["place"].square().sum()
        loss.backward()
        with torch.no_grad():
            self.tensors["place"] -= RATE * self.tensors["place"].grad
        self.tensors["place"].grad = None
        self.iteration += 1
        return {"squares": float(loss.detach())}

    def state(self) -> dict[str, Any]:
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        raise NotImplementedError

    def product(self) -> dict[str, Any]:
        return {}


def recorded(stage: Any) -> list[FirstStep]:
    first = FirstSteps()
    while stage.iteration < stage.iterations:
        with first.watching(stage) as lengths:
            losses = stage.step()
        first.add(stage.iteration, losses, lengths)
    return first.steps


def test_lengths_of_gradient_and_update_are_recorded() -> None:
    steps = recorded(Descent())
    assert [step["iteration"] for step in steps] == list(range(1, FIRST_STEPS + 1))
    for number, step in enumerate(steps):
        length = 3 * (1 - 2 * RATE) ** number
        assert step["losses"] == {"squares": pytest.approx(length**2)}
        assert step["gradients"] == {"place": pytest.approx(2 * length)}
        assert step["updates"] == {"place": pytest.approx(2 * RATE * length), "held": 0.0}


def test_a_stage_whose_optimiser_names_no_tensors_has_losses_alone() -> None:
    stage = Descent()
    stage.optimiser = torch.optim.SGD([stage.tensors["place"]], RATE)  # type: ignore[assignment]
    steps = recorded(stage)
    assert len(steps) == FIRST_STEPS
    assert all(step["losses"] and step["gradients"] == step["updates"] == {} for step in steps)


def geometry() -> FitGeometry:
    variant, budget = SurfelVariant(), GEOMETRY_PRESETS["smoke"]
    run = Run(sphere_scene(views=2, size=16), variant, budget, 0, CPU, Path())
    return FitGeometry(run, variant.geometry, budget, 1.0, Shading())


def test_watching_a_stage_on_surfels_changes_no_bit() -> None:
    watched, alone = geometry(), geometry()
    first = FirstSteps()
    for _ in range(FIRST_STEPS + 2):
        with first.watching(watched) as lengths:
            losses = watched.step()
        first.add(watched.iteration, losses, lengths)
        assert alone.step() == losses
    assert len(first.steps) == FIRST_STEPS
    assert all(step["gradients"]["sh"] > 0 for step in first.steps)
    for name, value in watched.optimiser.tensors.items():
        assert torch.equal(value, alone.optimiser.tensors[name]), name


def stored_alone(sweep: FakeSweep) -> Result:
    result = sweep.store.result(fake_cell().key)
    assert result is not None
    return result


def test_every_training_stage_records_the_machines_speed(tmp_path: Path) -> None:
    sweep = FakeSweep(tmp_path)
    sweep.run([fake_cell()])
    for stage in ("initialise", "invert"):
        assert 0 < stored_alone(sweep)["sessions"][stage][-1]["yardstick"] < 1
