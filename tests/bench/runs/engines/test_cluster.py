"""A Ray cluster ends with the table of a single process, also when one of its machines is lost in the middle."""

import importlib.util
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from bench import fake_method
from bench.clusters import SHARING, cluster_of, run_all, seconds_of_initialisation
from bench.fake_method import FakeSweep, asked
from bench.kill_everywhere import table
from radiogs_bench.cli import main
from radiogs_bench.errors import Interrupted
from radiogs_bench.runs.cell import Cell
from radiogs_bench.runs.engines import run
from radiogs_bench.runs.engines.choice import Engine, choose
from radiogs_bench.runs.engines.cluster import connected, run_on_cluster
from radiogs_bench.runs.engines.in_process import Task
from radiogs_bench.runs.interruption import Interruption
from radiogs_bench.runs.progress import LogProgress
from radiogs_bench.runs.stages import Bench
from radiogs_bench.store.folder import Store
from radiogs_core.errors import NumericalFailure, UsageError
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
def test_without_ray_the_command_says_what_to_install(
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
    """Remembers which cells are said to be done, and does something at a certain one."""

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
