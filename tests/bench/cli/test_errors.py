"""Errors end in the exit code of the table, and state what, why and what to do."""

import pytest

from radiogs_bench.errors import CellFailed, Interrupted, StoreError, exit_code, explain, worst_exit_code
from radiogs_core.errors import DataError, ExplainedError, NumericalFailure, UsageError


@pytest.mark.parametrize(
    ("kind", "code"),
    [(CellFailed, 1), (StoreError, 6), (UsageError, 2), (DataError, 3), (NumericalFailure, 4), (Interrupted, 130)],
)
def test_each_kind_of_error_has_its_exit_code(kind: type[ExplainedError], code: int) -> None:
    assert exit_code(kind("what")) == code


def test_the_message_has_three_parts_and_the_code() -> None:
    assert explain(DataError("what", "why", "remedy")) == "error: what\nwhy\nremedy\n(exit code 3)"


def test_a_requested_stop_is_no_error() -> None:
    assert explain(Interrupted("stopped as asked", "", "Run it again.")) == (
        "stopped as asked\nRun it again.\n(exit code 130)"
    )


def test_the_most_severe_failure_decides_the_exit_code() -> None:
    assert worst_exit_code([]) == 0
    assert worst_exit_code([CellFailed("a"), NumericalFailure("b"), CellFailed("c")]) == 4
    assert worst_exit_code([CellFailed("a")]) == 1
