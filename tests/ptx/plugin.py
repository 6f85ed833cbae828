"""A plugin of pytest: every test launches kernels from their PTX, and what they did is written when the tests end."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from ptx.launch import launched_from_ptx
from ptx.machine import Account

WHERE = "PTX_ACCOUNT"
"""Variable of the environment with the path of the file of the account."""

account = Account()


@pytest.fixture(autouse=True)
def _from_ptx() -> Iterator[None]:
    with launched_from_ptx(account, seed=0):
        yield


def pytest_sessionfinish() -> None:
    Path(os.environ[WHERE]).write_text(json.dumps(vars(account)), encoding="utf-8")
