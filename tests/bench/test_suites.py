"""Suites are sound data, and a wrong name is answered with the right one."""

import pytest

from radiogs.errors import UsageError
from radiogs.variant import Variant
from radiogs_bench.suites import ABLATIONS, MEASURES, SUITES, Metric, Row, Suite, suite


def test_the_ablations_are_the_five_rows_of_the_paper() -> None:
    assert [row.variant for row in ABLATIONS.rows] == [
        Variant(),
        Variant(radiometric_weight=0.0),
        Variant(detach="pbr"),
        Variant(detach="surfel"),
        Variant(initialise="nvs"),
    ]
    assert ABLATIONS.reference == "ours"


def test_suites_are_found_by_the_name_they_carry() -> None:
    for name in SUITES:
        assert suite(name).name == name


def test_every_column_has_a_heading_and_a_way_to_be_better() -> None:
    for column in (column for each in SUITES.values() for column in each.columns):
        assert Metric.of(column.key) == column
        assert column.label
        assert MEASURES[column.measure].better in {"up", "down"}


def test_a_misspelt_suite_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match="Did you mean 'ablations'"):
        suite("ablation")
    with pytest.raises(UsageError, match="Suites: ablations"):
        suite("xyz")


def test_a_suite_without_its_reference_row_or_with_rows_of_one_name_is_refused() -> None:
    rows = (Row("a", "A", "A", Variant()), Row("a", "B", "B", Variant()))
    with pytest.raises(UsageError, match="same key: a"):
        Suite("s", "S", "p", "a", rows, (Metric("nvs", "psnr"),))
    with pytest.raises(UsageError, match="no row 'b'"):
        Suite("s", "S", "p", "b", rows[:1], (Metric("nvs", "psnr"),))
