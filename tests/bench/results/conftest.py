"""Fixtures of the gate's tests: the fake method in RadioGS's place, a finished run of three seeds and its baseline."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.fake_method import FAKE, finished_sweep
from bench.gate_files import baseline_of_run
from radiogs_bench.installed_methods import substitutes


@pytest.fixture(scope="module")
def fake() -> Iterator[None]:
    """The fake method in RadioGS's place."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(substitutes, FAKE.name, FAKE)
        yield


@pytest.fixture(scope="module")
def finished(fake: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_sweep(tmp_path_factory.mktemp("run"), seeds=3)


@pytest.fixture
def baseline(finished: Path, tmp_path: Path) -> Path:
    return baseline_of_run(finished, tmp_path)
