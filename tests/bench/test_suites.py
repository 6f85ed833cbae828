"""Suites are sound data, and a wrong name is answered with the right one."""

import pytest

from bench.fake_method import SCENE
from radiogs.budget import budget, scaled
from radiogs.errors import UsageError
from radiogs.variant import Variant
from radiogs_baselines.published import published
from radiogs_bench.suites import ABLATIONS, MEASURES, SUITES, Metric, Row, Suite, suite
from radiogs_bench.sweep import Request


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
        suite("ablationss")
    with pytest.raises(UsageError, match="Suites: ablations, views"):
        suite("xyz")


def test_a_suite_without_its_reference_row_or_with_rows_of_one_name_is_refused() -> None:
    rows = (Row("a", "A", "A", Variant()), Row("a", "B", "B", Variant()))
    with pytest.raises(UsageError, match="same key: a"):
        Suite("s", "S", "p", "a", rows, (Metric("nvs", "psnr"),))
    with pytest.raises(UsageError, match="no row 'b'"):
        Suite("s", "S", "p", "b", rows[:1], (Metric("nvs", "psnr"),))


def test_every_row_that_the_paper_prints_for_ours_stands_beside_it() -> None:
    """Rows of a suite and its published table have the same keys; the paper's table may have other methods' rows."""
    for each in SUITES.values():
        table = published(each.published)
        assert {row.key for row in each.rows} <= table.figures.keys(), each.name


def test_no_two_rows_of_a_suite_run_the_same_thing() -> None:
    for each in SUITES.values():
        runs = [(row.variant, tuple(sorted(row.budget.items()))) for row in each.rows]
        assert len(set(runs)) == len(runs), each.name


@pytest.mark.parametrize("name", ["ng", "ns"])
def test_rows_of_one_knob_share_stage_one_and_nothing_else(name: str) -> None:
    cells = [cell for _, cell in Request(SUITES[name], {"fake": SCENE}, 1, budget("tiny"), "default", "cpu").cells()]
    assert len({cell.initialisation_key for cell in cells}) == 1
    assert len({cell.training_key for cell in cells}) == len(cells)
    knob = {"ng": "consistency_surfels", "ns": "incident_samples"}[name]
    values = [getattr(cell.budget, knob) for cell in cells]
    assert values == sorted(values)
    assert getattr(budget("tiny"), knob) in values


def test_a_preset_too_small_for_a_row_is_refused() -> None:
    with pytest.raises(UsageError, match="too small"):
        scaled(budget("smoke"), {"incident_samples": 0.01})
