"""Shapes and types are checked at run time in every test (jaxtyping with beartype)."""

import os
from pathlib import Path

import pytest
import torch
from jaxtyping import install_import_hook

from elsewhere import CAN_REGISTER, registered
from radiogs_core.kernels.runtime import use_threads

ROOT = Path(__file__).parents[1]
SHARED_DATA = Path(os.environ.get("RADIOGS_SHARED_DATA", ROOT.parent / "shared" / "data"))


def _checked_modules() -> list[str]:
    """Every module with shapes, but packages (a hook on one takes all it holds).

    Modules without shapes are left to the type checker: a check at each of their calls took a third of the tests' time.
    """
    rooms = ("method", "method", "datasets", "baselines", ".")
    packages = ("radiogs_core", "radiogs", "radiogs_datasets", "radiogs_baselines", "radiogs_bench")
    return [
        ".".join(path.relative_to(ROOT / room).with_suffix("").parts)
        for room, package in zip(rooms, packages, strict=True)
        for path in sorted((ROOT / room / package).rglob("*.py"))
        if path.stem != "__init__" and path.stem != "runtime" and "from jaxtyping import" in path.read_text()
    ]


os.environ["RADIOGS_BENCH_OFFLINE"] = "1"  # no test depends on what a network would give it
install_import_hook(_checked_modules(), "beartype.beartype")
if CAN_REGISTER:
    registered()  # autograd counts the devices once, in a process's first backward pass


@pytest.fixture
def shared_data() -> Path:
    """Real third-party files that the repository may not carry."""
    if not SHARED_DATA.is_dir():
        pytest.skip("third-party example data is not at hand (set RADIOGS_SHARED_DATA to its folder)")
    return SHARED_DATA


@pytest.fixture(autouse=True, scope="session")
def _two_threads() -> None:
    """Sums over workers round by their number; fixtures of whole modules come before those of their tests."""
    use_threads(2)


@pytest.fixture(autouse=True)
def _repeatable(_two_threads: None) -> None:
    torch.manual_seed(0)
    use_threads(2)
