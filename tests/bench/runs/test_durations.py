"""Seconds are said in the unit that fits."""

import pytest

from radiogs_bench.durations import duration, time_left


@pytest.mark.parametrize(
    ("seconds", "said"), [(0.4, "0 s"), (99.0, "99 s"), (150.0, "2 min"), (5400.0, "90 min"), (11100.0, "3 h 05 min")]
)
def test_time_left_is_printed_in_suitable_units(seconds: float, said: str) -> None:
    assert time_left(seconds) == said


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.04, "0.0 s"), (119.0, "119.0 s"), (120.0, "2.0 min"), (9000.0, "2.5 h"), (200_000.0, "2.3 days")],
)
def test_durations_are_printed_in_suitable_units(seconds: float, said: str) -> None:
    assert duration(seconds) == said
