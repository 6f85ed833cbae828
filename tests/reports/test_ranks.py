"""Ranks: of published values as printed, of measured ones as far as paired intervals tell rows apart."""

from made_up_run import summary
from radiogs_reports.analysis.ranks import printed_ranks, resolved_ranks, suite_ranks
from radiogs_reports.statistics import Sample


def seeds(*values: float) -> Sample:
    return {("ball", seed): value for seed, value in enumerate(values)}


LEVELS = (30.0, 33.0, 36.0)
"""By seed: far apart, so that only pairs resolve a decibel."""


def shifted(*by: float) -> Sample:
    return seeds(*(level + each for level, each in zip(LEVELS, by, strict=True)))


def test_equal_print_has_equal_rank_and_the_next_value_the_next_rank() -> None:
    assert printed_ranks({"a": 31.23, "b": 31.23, "c": 30.0}, "up") == {"a": 1, "b": 1, "c": 2}
    assert printed_ranks({"a": 31.23, "b": 30.0}, "down") == {"a": 2, "b": 1}
    assert printed_ranks({"a": -0.1, "b": 0.2}, "zero") == {"a": 1, "b": 2}


def test_rows_that_pairs_do_not_tell_apart_share_a_rank() -> None:
    rows = {"best": shifted(0.1, 0.0, 0.0), "close": shifted(-0.2, 0.1, 0.0), "worse": shifted(-1.0, -1.1, -0.9)}
    assert resolved_ranks(rows, "up") == {"best": 1, "close": 1, "worse": 2}
    assert resolved_ranks({row: seeds(*(-each for each in rows[row].values())) for row in rows}, "down") == {
        "best": 1, "close": 1, "worse": 2,
    }  # fmt: skip


def test_a_row_is_compared_with_the_best_of_the_rank_and_not_with_its_neighbour() -> None:
    rows = {name: shifted(step, step, step + noise) for name, step, noise in (
        ("a", 0.0, 0.0), ("b", -0.10, 0.15), ("c", -0.2, 0.05))}  # fmt: skip
    assert resolved_ranks(rows, "up") == {"a": 1, "b": 1, "c": 2}


def test_magnitudes_count_where_zero_is_best() -> None:
    assert resolved_ranks({"low": seeds(-3.0, -3.1, -2.9), "high": seeds(1.0, 1.1, 0.9)}, "zero") == {
        "high": 1, "low": 2,
    }  # fmt: skip


def test_one_pair_resolves_nothing() -> None:
    assert resolved_ranks({"a": seeds(30.0), "b": seeds(10.0)}, "up") == {}
    assert resolved_ranks({"a": seeds(30.0, 31.0)}, "up") == {}
    assert resolved_ranks({"a": seeds(30.0, 31.0), "none": {}}, "up") == {}


def test_tables_show_the_ranks_of_the_summary_and_none_without_a_reference_row() -> None:
    made = summary()
    assert suite_ranks(made, made["columns"][0]) == {"ours": 1, "no-rad": 2}
    made["reference"] = None
    assert suite_ranks(made, made["columns"][0]) == {}
