"""Cells on a Ray cluster, and on what takes its place here."""

import importlib.util
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import pytest

from bench import fake_method
from bench.chain_method import Chain, Steps, Turned
from bench.clusters import SHARING, cluster_of, run_all, seconds_of_initialisation
from bench.fake_method import SCENE, FakeSweep, asked
from bench.kill_everywhere import table
from radiogs_bench.cli import main
from radiogs_bench.errors import Interrupted
from radiogs_bench.methods import FoundMethods
from radiogs_bench.runs.cell import Cell, Work, cell_of
from radiogs_bench.runs.engines import run
from radiogs_bench.runs.engines.choice import Engine, choose
from radiogs_bench.runs.engines.cluster import connected, run_on_cluster, unsent
from radiogs_bench.runs.engines.delegate import Recipe
from radiogs_bench.runs.engines.in_process import Task
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.stages import Bench
from radiogs_bench.runs.train import train_and_score
from radiogs_bench.scoring.evaluate import Evaluation
from radiogs_bench.store.folder import Store
from radiogs_bench.store.schema import MetricValue
from radiogs_core.contract import StageSpec
from radiogs_core.errors import DataError, NumericalFailure, UsageError
from radiogs_core.scene.scene import Scene

CELLS = [cell for _, cell in asked(3).cells]
CELL_SECONDS = 0.5
"""Long enough for a machine to be lost while it works on one."""

needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed (make extras)")


def slow(bench: Bench, cell: Cell, scene: Scene) -> None:
    time.sleep(CELL_SECONDS)
    fake_method.experiment(bench, cell, scene)


def bad(bench: Bench, cell: Cell, scene: Scene) -> None:
    if cell.seed == 2 and cell.variant.detach == "pbr":
        raise NumericalFailure("the image is not finite", "A NaN.", "Look.")
    fake_method.experiment(bench, cell, scene)


@pytest.mark.parametrize(
    ("asked", "engine"),
    [
        ((None, None, None), Engine("inprocess")),
        ((None, 1, None), Engine("inprocess", 1)),
        ((None, 3, None), Engine("pool", 3)),
        (("pool", None, None), Engine("pool")),
        (("ray", None, None), Engine("ray")),
        ((None, None, "head:6379"), Engine("ray", None, "head:6379")),
    ],
)
def test_options_say_which_engine(asked: tuple[str | None, int | None, str | None], engine: Engine) -> None:
    assert choose(*asked) == engine


@pytest.mark.parametrize(
    "asked", [("inprocess", 2, None), ("ray", 2, None), ("pool", None, "head:6379"), ("inprocess", None, "head:6379")]
)
def test_options_that_do_not_go_together_are_refused(asked: tuple[str | None, int | None, str | None]) -> None:
    with pytest.raises(UsageError, match="does not go with --engine"):
        choose(*asked)


@pytest.mark.slow
def test_without_ray_the_command_names_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before kernels are compiled, and before anything is trained."""
    monkeypatch.setitem(sys.modules, "ray", None)
    monkeypatch.setattr(run, "preflight", lambda *given: pytest.fail("kernels would be compiled"))
    assert main(["run", "ablations", "--preset", "smoke", "--engine", "ray", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "pip install 'radiogs-bench[cluster]'" in said
    assert not list(tmp_path.rglob("*.pt"))


@needs_ray
def test_a_cluster_that_does_not_answer_is_an_error() -> None:
    with pytest.raises(UsageError, match=r"no Ray cluster answers at 127\.0\.0\.1:9"), connected("127.0.0.1:9"):
        pass


@pytest.fixture
def two_machines(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # the machines find the fake method where we do
    from ray.cluster_utils import Cluster as LocalCluster

    cluster = LocalCluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.second = cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        yield cluster
    finally:
        cluster.shutdown()


class Lines(LogProgress):
    """Records which cells are reported as done, and does something at a given one."""

    def __init__(self, at: int = -1, act: Callable[[], None] = lambda: None) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.at, self.act = at, act

    def say(self, line: str) -> None:
        if "done on" not in line:  # how much is left is said by the minute
            return
        self.lines.append(line)
        if len(self.lines) == self.at:
            self.act()


def run_there(address: str, folder: Path, experiment: Any, progress: LogProgress, interruption: Interruption) -> Any:
    store = Store(folder)
    with connected(address) as ray:
        cluster = cluster_of(ray, folder, experiment)
        assert cluster.can_run()
        return run_on_cluster([Task(cell, cell.key) for cell in CELLS], cluster, store, progress, interruption)


@needs_ray
@pytest.mark.slow
def test_the_command_sends_its_cells_through_a_cluster_of_its_own(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ["run", "ablations", "--rows", "ours,no-rad", "--scenes", "corner", "--preset", "smoke", "--threads", "1"]
    assert main([*command, "--engine", "ray", "--out", str(out)]) == 0
    results = Store(out).results()
    assert sorted(result["cell"]["variant"]["radiometric_weight"] == 0 for result in results) == [False, True]
    assert (out / "report.html").exists()


@needs_ray
@pytest.mark.slow
def test_a_lost_machine_costs_no_result(two_machines: Any, tmp_path: Path) -> None:
    whole = FakeSweep(tmp_path / "whole")
    whole.run(CELLS)
    killer = Thread(target=two_machines.remove_node, args=(two_machines.second,), kwargs={"allow_graceful": False})
    progress = Lines(at=4, act=killer.start)
    failures = run_there(two_machines.address, tmp_path / "there", slow, progress, Interruption())
    killer.join()
    assert failures == []
    assert len(two_machines.list_all_nodes()) == 1
    assert len(progress.lines) == len(CELLS)
    assert table(tmp_path / "there") == table(tmp_path / "whole")
    assert not list(tmp_path.rglob("*.failed.json"))
    assert list((tmp_path / "there" / "locks").iterdir()) == []


@needs_ray
@pytest.mark.slow
def test_a_stop_keeps_what_is_finished_and_a_failing_cell_leaves_the_others_alone(
    two_machines: Any, tmp_path: Path
) -> None:
    interruption = Interruption()

    def ask() -> None:
        interruption.requested = True

    with pytest.raises(Interrupted, match="Run the same command again"):
        run_there(two_machines.address, tmp_path, slow, Lines(at=3, act=ask), interruption)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "cells").glob("*.json")}
    assert 3 <= len(before) < len(CELLS)
    failures = run_there(two_machines.address, tmp_path, bad, Lines(), Interruption())
    assert [failure.what for failure in failures] == ["the image is not finite"]
    assert all(path.stat().st_mtime_ns == moment for path, moment in before.items())
    assert len(list((tmp_path / "cells").glob("*.failed.json"))) == 1
    assert len(list(Store(tmp_path).results())) == len(CELLS) - 1


@needs_ray
@pytest.mark.slow
def test_two_suites_on_a_cluster_train_their_first_stage_once(two_machines: Any, tmp_path: Path) -> None:
    FakeSweep(tmp_path / "whole").run(SHARING)
    with connected(two_machines.address) as ray:
        for cells in (SHARING[:1], SHARING):
            assert run_all(cluster_of(ray, tmp_path / "there"), cells) == []
    assert table(tmp_path / "there") == table(tmp_path / "whole")
    assert len(seconds_of_initialisation(tmp_path / "there", SHARING)) == 1


class HereInsteadOfRay:
    """Answers as the module does; what travels is pickled there and back."""

    exceptions = SimpleNamespace(RayTaskError=ArithmeticError, RayError=OSError)

    def __init__(self) -> None:
        self.called: list[str] = []
        self.objects: dict[str, bytes] = {}

    def remote(self, **needs: Any) -> Callable[[Any], Any]:
        return lambda function: SimpleNamespace(remote=partial(self._call, function))

    def _call(self, function: Any, *given: Any) -> str:
        self.called.append(function.__name__)
        travelled = [self.get(each) if isinstance(each, str) else pickle.loads(pickle.dumps(each)) for each in given]
        return self.put(function(*travelled))

    def put(self, value: Any) -> str:
        name = f"object {len(self.objects)}"
        self.objects[name] = pickle.dumps(value)
        return name

    def get(self, name: str) -> Any:
        return pickle.loads(self.objects[name])

    def wait(self, names: list[str], num_returns: int, timeout: float) -> tuple[list[str], list[str]]:
        return names, []

    def cancel(self, name: str, force: bool) -> None:
        """Everything is over at once."""

    def nodes(self) -> list[dict[str, Any]]:
        return [{"Alive": True, "Resources": {"CPU": 1.0}}]


def three_stages(name: str) -> Chain:
    return Chain(("coarse", "fine", "polish"))


def one_stage(name: str) -> Chain:
    return Chain(("fit",))


def chain_experiment(bench: Bench, cell: Cell, scene: Scene) -> None:
    """Train a chain, and score where it has ended."""

    def score(bench: Bench, cell: Cell, scene: Scene, model: Any) -> Evaluation:
        value = MetricValue(value=model.facts()["value"], reason=None, views=[])
        return Evaluation({"nvs/psnr": value}, {}, [], "view", None, None, {}, {"name": "fake"})

    train_and_score(bench, cell, scene, score=score)


def chain_cell(chain: Chain, **turned: float) -> Cell:
    return cell_of(chain, SCENE, Work(Turned(**turned), chain.presets["smoke"]))


def test_cells_of_two_suites_share_their_first_stage(tmp_path: Path) -> None:
    """One task completes it, and all cells get its outcome; later calls find it in the store, too."""
    assert len({cell.stages[0].key for cell in SHARING}) == 1
    assert len({cell.stages[1].key for cell in SHARING}) == len(SHARING)
    FakeSweep(tmp_path / "whole").run(SHARING)
    ray = HereInsteadOfRay()
    assert run_all(cluster_of(ray, tmp_path / "there"), SHARING[:2]) == []
    assert ray.called == ["run_shared_stages", "run_remote_cell", "run_remote_cell"]
    assert run_all(cluster_of(ray, tmp_path / "there"), SHARING) == []
    assert ray.called[3:] == ["run_remote_cell"], "two are finished, and the stage is in the store"
    assert table(tmp_path / "there") == table(tmp_path / "whole")
    assert len(seconds_of_initialisation(tmp_path / "there", SHARING)) == 1
    assert list((tmp_path / "there" / "locks").iterdir()) == []


def test_cells_that_share_stages_are_on_the_cluster_together(tmp_path: Path) -> None:
    """No cell waits for the stage to land: one task serves all of them."""
    ray = HereInsteadOfRay()
    cluster = cluster_of(ray, tmp_path)
    assert unsent(cluster, [Task(cell, cell.key) for cell in SHARING]) == []
    assert ray.called == ["run_shared_stages", *["run_remote_cell"] * 3]
    cluster.abandon()
    assert list((tmp_path / "locks").iterdir()) == []


def test_cells_wait_for_a_first_stage_that_another_process_trains(tmp_path: Path) -> None:
    """They are sent as soon as it is let go, and nothing else waits for that."""
    cluster, said = cluster_of(HereInsteadOfRay(), tmp_path), []
    other = asked(2).cells[-1][1]
    theirs = cluster.store.claim(f"stages-{SHARING[0].first_key}")
    theirs.__enter__()

    class LetGo(LogProgress):
        def say(self, line: str) -> None:
            said.append(line)
            if len(said) == 1:
                theirs.__exit__(None, None, None)

    tasks = [Task(cell, cell.key) for cell in (SHARING[0], other)]
    assert run_on_cluster(tasks, cluster, cluster.store, LetGo(), Interruption()) == []
    assert [line.partition(":")[0] for line in said] == [other.key, SHARING[0].key]


def test_a_failure_that_all_cells_would_share_ends_the_run_and_lets_everything_go(tmp_path: Path) -> None:
    cluster = cluster_of(HereInsteadOfRay(), tmp_path, method=fake_method.method)
    cluster.recipe = Recipe(fake_method.method, fake_method.experiment, elsewhere, "nowhere/fake")
    with pytest.raises(DataError, match="there is no scene"):
        run_all(cluster, SHARING)
    assert not list(tmp_path.rglob("*.pt"))
    assert list((tmp_path / "locks").iterdir()) == []


def elsewhere(name: str) -> Scene:
    raise DataError(f"there is no scene '{name}'")


def test_stages_between_the_first_and_the_last_are_shared_too(tmp_path: Path) -> None:
    ray, chain = HereInsteadOfRay(), three_stages("")
    cells = [chain_cell(chain, shown=shown) for shown in (1.0, 2.0)]
    assert run_all(cluster_of(ray, tmp_path, chain_experiment, three_stages), cells) == []
    assert ray.called == ["run_shared_stages", "run_remote_cell", "run_remote_cell"]
    kept = {path.stem for path in (tmp_path / "stages").glob("*.pt")}
    assert kept == {stage.key for cell in cells for stage in cell.stages}


def test_found_methods_are_pickled_without_the_methods() -> None:
    found = FoundMethods()
    assert found("radiogs") is found("radiogs")
    sent = pickle.dumps(found)
    assert sent == pickle.dumps(FoundMethods())
    assert pickle.loads(sent)("radiogs").name == "radiogs"


def test_a_method_of_one_stage_has_no_task_but_its_cells(tmp_path: Path) -> None:
    ray = HereInsteadOfRay()
    assert run_all(cluster_of(ray, tmp_path, chain_experiment, one_stage), [chain_cell(one_stage(""))]) == []
    assert ray.called == ["run_remote_cell"]


class Parting(Chain):
    """Its first stage reads nothing that ablations turn."""

    def stages(self, variant: Turned, budget: Steps) -> Sequence[StageSpec]:
        first, *rest = super().stages(variant, budget)
        return [replace(first, reads={}), *rest]


def parting(name: str) -> Chain:
    return Parting(("coarse", "fine", "polish"))


def test_cells_that_part_after_the_first_stage_run_it_once(tmp_path: Path) -> None:
    """The second's own shared stage begins from the first stage that the first cell's has left in the store."""
    ray, chain = HereInsteadOfRay(), parting("")
    cells = [chain_cell(chain, weight=weight) for weight in (1.0, 2.0)]
    assert [mine.key == other.key for mine, other in zip(*(cell.stages for cell in cells), strict=True)] == [
        True,
        False,
        False,
    ]
    cluster = cluster_of(ray, tmp_path, chain_experiment, parting)
    assert run_all(cluster, cells) == []
    assert ray.called == ["run_shared_stages", "run_remote_cell"] * 2
    results = [cluster.store.result(cell.key) for cell in cells]
    assert len({result["seconds"]["coarse"] for result in results if result is not None}) == 1
    assert len({result["seconds"]["fine"] for result in results if result is not None}) == 2
