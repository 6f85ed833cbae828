"""The command line with the fake method in place of RadioGS, and a run that it has finished."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from bench import fake_method
from bench.chain_method import Chain
from radiogs_bench.cli import main
from radiogs_bench.installed_methods import substitutes
from radiogs_bench.runs import preflight, train
from radiogs_bench.runs.engines import run as sweeping
from radiogs_bench.suites import scenes
from radiogs_reports import run_folder
from scenes import sphere_scene


@pytest.fixture(autouse=True, scope="module")
def _without_figures(request: pytest.FixtureRequest) -> Iterator[None]:
    """Reports without figures, which take most of their time and have tests of their own in tests/reports.

    A module that looks at them sets WITH_FIGURES.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not getattr(request.module, "WITH_FIGURES", False):
            patch.setattr(run_folder, "write_figures", lambda summary, out: [])
        yield


@pytest.fixture
def chain(monkeypatch: pytest.MonkeyPatch) -> Chain:
    """A method without recipes."""
    chain = Chain(("fit",))
    monkeypatch.setitem(substitutes, "chain", chain)
    return chain


@pytest.fixture
def fake_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """``radiogs-bench run`` with further arguments, two seeds, into ``tmp_path``; returns the exit code."""
    monkeypatch.setitem(substitutes, fake_method.FAKE.name, fake_method.FAKE)
    monkeypatch.setattr(train, "train_and_score", fake_method.experiment)
    for module in (scenes, preflight, sweeping):
        monkeypatch.setattr(module, "load_scene", lambda name, **how: sphere_scene(views=2, size=16))
    fake_method.begun.clear()

    def start(*further: str) -> int:
        return main(
            ["run", "--scenes", "corner", "--seeds", "2", "--preset", "smoke", "--out", str(tmp_path), *further]
        )

    return start


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of five cells, which nobody changes."""
    return fake_method.finished_sweep(tmp_path_factory.mktemp("run"))


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return shutil.copytree(made, tmp_path / "run")
