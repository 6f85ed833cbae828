"""Shapes and types are checked at run time in every test (jaxtyping with beartype)."""

import os
from pathlib import Path

import pytest
import torch
from jaxtyping import install_import_hook

install_import_hook(["radiogs", "radiogs_datasets", "radiogs_bench"], "beartype.beartype")

SHARED_DATA = Path(os.environ.get("RADIOGS_SHARED_DATA", Path(__file__).parents[2] / "shared" / "data"))


@pytest.fixture
def shared_data() -> Path:
    """Real third-party files that the repository may not carry."""
    if not SHARED_DATA.is_dir():
        pytest.skip("third-party example data is not at hand (set RADIOGS_SHARED_DATA to its folder)")
    return SHARED_DATA


@pytest.fixture(autouse=True)
def _seed() -> None:
    torch.manual_seed(0)
