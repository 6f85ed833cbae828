"""The command line with the fake method in place of RadioGS."""

from collections.abc import Callable
from pathlib import Path

import pytest

from bench import fake_method
from radiogs_bench.cli import main
from radiogs_bench.methods import substitutes
from radiogs_bench.runs import preflight, train
from radiogs_bench.runs.engines import run as sweeping
from radiogs_bench.suites import scenes
from scenes import sphere_scene


@pytest.fixture
def fake_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """``radiogs-bench run`` with further arguments, two seeds, into ``tmp_path``; returns the exit code."""
    monkeypatch.setitem(substitutes, fake_method.FAKE.name, fake_method.FAKE)
    monkeypatch.setattr(train, "train_and_score", fake_method.experiment)
    for module in (scenes, preflight, sweeping):
        monkeypatch.setattr(module, "load_scene", lambda name, **how: sphere_scene(views=2, size=16))
    fake_method.begun.clear()

    def start(*further: str) -> int:
        return main(["run", "--seeds", "2", "--preset", "smoke", "--out", str(tmp_path), *further])

    return start
