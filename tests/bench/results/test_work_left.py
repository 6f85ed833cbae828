"""The time left of a run is taken from the same row, and shared stages count once."""

from typing import Any, cast

import pytest

from radiogs_bench.results.standing import work_left
from radiogs_bench.runs.sweep import CellRef
from radiogs_bench.store.schema import Result


def place(row: str, seed: int, stages: list[str]) -> CellRef:
    return cast(CellRef, {"row": row, "scene": "s", "seed": seed, "key": f"{row}-{seed}", "stages": stages})


def result(first: tuple[str, float], second: tuple[str, float], scored: float) -> Result:
    keys = {"one": first[0], "two": second[0]}
    seconds = {"one": first[1], "two": second[1], "evaluate": scored}
    return cast(Result, cast(Any, {"cell": {"stages": keys}, "seconds": seconds}))


def test_seconds_come_from_the_same_row_or_else_from_all_rows() -> None:
    wanted = [("slow", 0), ("fast", 0), ("new", 0), ("slow", 1), ("fast", 1), ("new", 1), ("slow", 2)]
    places = [place(row, seed, [f"shared-{seed}", f"{row}-{seed}"]) for row, seed in wanted]
    finished = {
        "slow-0": result(("shared-0", 100.0), ("slow-0", 50.0), 7.0),
        "fast-0": result(("shared-0", 100.0), ("fast-0", 10.0), 3.0),
    }
    trained = {"shared-0", "slow-0", "fast-0"}
    left = work_left(places, finished, trained)
    # slow 1 and slow 2: 100 + 50 + 7; fast 1: 10 + 3; new 0 and new 1: 30 + 5, the means of both rows
    assert (left.cells, left.stages) == (5, 7)
    assert left.seconds == pytest.approx(2 * 157 + 13 + 2 * 35)
    assert work_left(places[3:4], finished, trained).seconds is None
