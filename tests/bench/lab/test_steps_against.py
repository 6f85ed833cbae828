"""``bench steps --against``: another checkout is measured by its own harness and with its own sources."""

import json
import shutil
from pathlib import Path

import pytest

from radiogs_bench.cli import main
from radiogs_bench.errors import Killed
from radiogs_bench.lab.steps.against import worker
from radiogs_core.errors import UsageError

ROOT = Path(__file__).parents[3]

STEPS = "radiogs_bench/lab/steps"

ANSWERS = """
import json, sys
from pathlib import Path
print(json.dumps({"sources": str(Path(SOURCES)), "git": None}), flush=True)
for line in sys.stdin:
    asked = json.loads(line)
    if asked["size"] == "deadly":
        sys.exit(7)
    print(json.dumps({"asked": asked, "given": sys.argv[1:]}), flush=True)
"""
"""A worker that measures nothing."""

WAITING = """

import time
at_once = SurfelOptimiser.step

def step(self):
    until = time.process_time() + 0.05
    while time.process_time() < until:
        pass
    at_once(self)

SurfelOptimiser.step = step
"""


def made_checkout(folder: Path, where: str = STEPS, sources: str = "method/radiogs_core") -> Path:
    """A checkout whose harness has two sizes, and a worker that says that its packages lie in ``sources``."""
    place = folder / where
    place.mkdir(parents=True)
    for package in (place, *place.relative_to(folder).parents):
        (folder / package / "__init__.py").touch()
    (place / "sizes.py").write_text('SIZES = {"odd": None, "deadly": None}\n')
    (place / "worker.py").write_text(ANSWERS.replace("SOURCES", repr(str(folder / sources))))
    return folder


@pytest.mark.parametrize("where", [STEPS, "radiogs_bench/step_bench"])
def test_the_harness_of_the_checkout_answers_wherever_it_kept_its_worker(where: str, tmp_path: Path) -> None:
    with worker(made_checkout(tmp_path, where), ("radiogs", "corner"), ["odd"]) as other:
        assert other.passed("odd", counts=True) == {
            "asked": {"size": "odd", "counts": True}, "given": ["radiogs", "corner"],
        }  # fmt: skip
        with pytest.raises(Killed, match="ended with code 7"):
            other.passed("deadly", counts=False)


def test_a_size_that_the_checkout_does_not_know_is_named_with_those_that_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "steps", "--sizes", "tiny,floor", "--against", str(made_checkout(tmp_path))]) == 2
    said = capsys.readouterr().err
    for text in ("does not know the size tiny, floor", "its own sizes: odd, deadly", "--sizes"):
        assert text in said


def test_a_checkout_whose_packages_lie_elsewhere_is_refused(tmp_path: Path) -> None:
    checkout = made_checkout(tmp_path / "checkout", sources=str(tmp_path / "installed"))
    with pytest.raises(UsageError, match="are not those that were found"), worker(checkout, (), ["odd"]):
        pass


@pytest.mark.slow
def test_another_checkout_is_measured_by_its_own_sources(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A copy whose optimiser waits for 50 ms is slower where the optimiser steps, and nowhere else."""
    for room in ("radiogs_bench", "method", "datasets", "baselines", "reports"):
        shutil.copytree(ROOT / room, tmp_path / "other" / room, ignore=shutil.ignore_patterns("__pycache__"))
    optimiser = tmp_path / "other" / "method" / "radiogs_core" / "surfels" / "optimiser.py"
    optimiser.write_text(optimiser.read_text() + WAITING)
    record = tmp_path / "against.json"
    given = ["--against", str(tmp_path / "other"), "--sizes", "smoke", "--passes", "2", "--json", str(record)]
    assert main(["bench", "steps", *given]) == 0
    ratios = {each["title"]: each["value"] for each in json.loads(record.read_text())["ratios"]["smoke"]}
    assert ratios["stage 1, initialisation: step"] > 2
    assert ratios["relighting by rays, split sum: preparing"] < 2
    assert "times as fast" in capsys.readouterr().out
