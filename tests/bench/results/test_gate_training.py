"""Trainings are compared by their losses, gradients, updates and counters, exactly where these repeat."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from bench.gate_files import baseline_of_run
from radiogs_bench.results.gate import Change, compare
from radiogs_bench.results.gate_training import COUNTED, ELSEWHERE, REPEATED
from radiogs_bench.results.training_steps import largest_difference, log_ratios, work_ratios
from radiogs_bench.runs.sweep import read_sweep
from radiogs_bench.store.folder import Store

OURS, LOSS = "fake ours", "invert/loss/distance"
STAGE = "stage invert: "


@pytest.fixture(scope="module")
def content(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return json.loads(baseline_of_run(finished, tmp_path_factory.mktemp("baseline")).read_text())  # type: ignore[no-any-return]


def elsewhere(content: dict[str, Any], noise: dict[str, dict[str, list[float]]]) -> dict[str, Any]:
    """The baseline as if of another machine, with a rerun that has this noise of row ours."""
    moved: dict[str, Any] = json.loads(json.dumps(content))
    moved["machine"]["cpu"] = "another"
    moved["reruns"] = 1
    groups = {name.rsplit(" seed ", 1)[0] for name in moved["cells"]}
    moved["noise"] = {"metrics": {group: {"nvs/psnr": [0.0] * 3} for group in groups}, "training": {}, "work": {}}
    for family, values in noise.items():
        moved["noise"][family][OURS] = values
    return moved


def scaled(content: dict[str, Any], factor: float, quantity: str = LOSS) -> dict[str, Any]:
    """The baseline with a quantity of row ours divided by a factor, so that the run's is larger by it."""
    moved: dict[str, Any] = json.loads(json.dumps(content))
    for name, cell in moved["cells"].items():
        if name.startswith(OURS):
            cell["training"][quantity] = [value / factor for value in cell["training"][quantity]]
    return moved


def found(finished: Path, content: dict[str, Any], severity: str = "changed") -> list[Change]:
    return [each for each in compare(Store(finished), read_sweep(finished), content) if each.severity == severity]


@pytest.mark.parametrize(("factor", "changed"), [(1 + 0.3 * REPEATED, False), (1 + 5 * REPEATED, True), (0.5, True)])
def test_on_one_machine_the_losses_of_the_first_steps_repeat(
    factor: float, changed: bool, finished: Path, content: dict[str, Any]
) -> None:
    lines = found(finished, scaled(content, factor))
    assert [each.cell for each in lines] == [OURS] * changed
    if factor == 0.5:
        said = "loss 'distance' in the first 8 steps smaller by 50 % (0.5 times the baseline's)"
        assert lines[0].what == STAGE + said


@pytest.mark.parametrize(("factor", "changed"), [(1.0, False), (1.05, False), (0.5, True), (2.0, True)])
def test_on_another_machine_quantities_are_tested_against_a_rerun(
    factor: float, changed: bool, finished: Path, content: dict[str, Any]
) -> None:
    there = elsewhere(content, {"training": {LOSS: [0.04, -0.04, 0.03]}})
    lines = found(finished, scaled(there, factor))
    assert [each.cell for each in lines] == [OURS] * changed
    assert all("a rerun differs by 3.7 %" in each.what for each in lines)


def test_on_another_machine_rounding_passes_even_without_rerun_noise(finished: Path, content: dict[str, Any]) -> None:
    there = elsewhere(content, {"training": {LOSS: [0.0, 0.0, 0.0]}})
    for share, changed in ((0.5, False), (2.0, True)):
        assert bool(found(finished, scaled(there, 1 + share * ELSEWHERE))) is changed


@pytest.mark.parametrize(
    ("values", "said"), [(None, "is new"), ([0.0] * 3, "is no longer zero"), ([-1.0] * 3, "has the other sign")]
)
def test_a_lost_or_negated_term_is_reported_on_every_machine(
    values: list[float] | None, said: str, finished: Path, content: dict[str, Any]
) -> None:
    for known in (content, elsewhere(content, {})):
        moved = json.loads(json.dumps(known))
        for name, cell in moved["cells"].items():
            if name.startswith(OURS) and values is None:
                del cell["training"][LOSS]
            elif name.startswith(OURS):
                cell["training"][LOSS] = values
        (line,) = found(finished, moved)
        assert line.what == f"{STAGE}loss 'distance' in the first 8 steps {said}"


def test_a_missing_loss_term_is_reported(finished: Path, content: dict[str, Any]) -> None:
    moved = json.loads(json.dumps(content))
    for name, cell in moved["cells"].items():
        if name.startswith(OURS):
            cell["training"]["invert/loss/ssim"] = [1.0, 1.0, 1.0]
    (line,) = found(finished, moved)
    assert line.what == f"{STAGE}loss 'ssim' in the first 8 steps is gone"


def test_of_many_quantities_the_largest_differences_are_listed(finished: Path, content: dict[str, Any]) -> None:
    moved = json.loads(json.dumps(content))
    for name, cell in moved["cells"].items():
        if name.startswith(OURS):
            cell["training"] |= {f"invert/loss/{number}": [1.0] for number in range(9)}
    lines = found(finished, moved)
    assert len(lines) == 6
    assert lines[-1].what == f"{STAGE}4 more quantities differ, by less"


def test_missing_gradients_of_baseline_or_run_are_reported(finished: Path, content: dict[str, Any]) -> None:
    said = [each for each in found(finished, content, "remark") if "no gradients" in each.what]
    assert [each.cell for each in said] == ["the baseline", "the run"]


class OtherWork(Store):
    """A store in which the counter ``steps`` of row ours has another name, and other amounts."""

    def __init__(self, folder: Path, name: str, amount: int) -> None:
        super().__init__(folder)
        self.name, self.amount = name, amount

    def sealed_result(self, key: str) -> Any:
        result: Any = super().sealed_result(key)
        return {**result, "work": {**result["work"], "invert": {self.name: self.amount, "begun": 1}}}


def of_work(finished: Path, content: dict[str, Any], name: str, before: int, now: int) -> list[str]:
    """Severities of what the gate finds where a counter was ``before`` in the baseline."""
    moved = json.loads(json.dumps(content))
    for cell in moved["cells"].values():
        cell["work"]["invert"] = {name: before, "begun": 1}
    changes = compare(OtherWork(finished, name, now), read_sweep(finished), moved)
    return [each.severity for each in changes if each.cell == OURS and "work" in each.what]


@pytest.mark.parametrize(("counter", "more", "less"), [("rays", "changed", "changed"),
                                                       ("node_visits", "regression", "better")])  # fmt: skip
def test_on_one_machine_every_count_matters_and_only_fewer_visits_are_better(
    counter: str, more: str, less: str, finished: Path, content: dict[str, Any]
) -> None:
    assert of_work(finished, content, counter, 22_490_680, 22_490_682) == [more]
    assert of_work(finished, content, counter, 22_490_680, 22_490_678) == [less]
    assert of_work(finished, content, counter, 22_490_680, 22_490_680) == []


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_elsewhere_a_counter_may_differ_by_rounding(noise: float, finished: Path, content: dict[str, Any]) -> None:
    there = elsewhere(content, {"work": {"invert/rays": [noise, -noise, noise]}})
    band = max(COUNTED, 10 * noise)
    for share, severities in ((0.00001, []), (0.02 if noise else 0.5, []), (2.0, ["changed"])):
        now = round(10_000_000 * (1 + share * band))
        assert of_work(finished, there, "rays", 10_000_000, now) == severities


def test_elsewhere_without_a_rerun_a_counter_is_a_warning(finished: Path, content: dict[str, Any]) -> None:
    there = {**elsewhere(content, {}), "reruns": 0}
    assert of_work(finished, there, "rays", 10, 20) == ["warning"]


def test_ratios_are_means_of_logarithms_over_the_steps_that_both_have() -> None:
    found = log_ratios({"a": [2.0, 8.0, None, 5.0], "b": [1.0, 0.0]}, {"a": [1.0, 2.0, 3.0], "b": [1.0, 0.0]})
    assert found == {"a": pytest.approx(math.log(8) / 2), "b": 0.0}
    assert log_ratios({"a": [0.0]}, {"a": [1.0]}) == {"a": "has become zero"}


def test_a_step_that_only_one_has_is_a_difference_without_bound() -> None:
    assert largest_difference([1.0, None], [1.0, None]) == 0
    assert largest_difference([1.0, 2.0], [1.0, None]) == math.inf
    assert largest_difference([1.0, 2.0], [1.0]) == math.inf
    assert largest_difference([0.0, -1.0], [0.0, 1.0]) == 2


def test_counters_that_are_zero_or_gone_have_no_ratio() -> None:
    now, before = {"fit": {"rays": 4, "new": 1, "none": 0}}, {"fit": {"rays": 2, "gone": 1, "none": 0}}
    assert work_ratios(now, before) == {
        "fit/rays": pytest.approx(math.log(2)), "fit/gone": "is gone", "fit/none": 0.0, "fit/new": "is new",
    }  # fmt: skip
