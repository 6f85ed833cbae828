"""Suites of what L_rad is worth: where they begin and end, and what their rows have."""

from itertools import combinations

from radiogs.recipes import PRINTED, RECIPES
from radiogs.settings import Variant
from radiogs_bench.methods import method, variant_by_recipe
from radiogs_bench.suites.consistency import CONSISTENCY_LENGTH, DEPARTURE_GROUPS, DEPARTURES, RIVALS
from radiogs_bench.suites.suite import Row
from radiogs_core.plain_values import flat, to_plain


def values_of(row: Row) -> dict[str, object]:
    """The variant of a row by dotted names."""
    return flat(to_plain(variant_by_recipe(method(row.method), row.recipe, "blender", "corner", row.variant)))


def test_departures_begin_as_printed_and_end_as_recommended() -> None:
    assert values_of(DEPARTURES.rows[0]) == values_of(Row("printed", "", "", recipe="printed"))
    assert values_of(DEPARTURES.rows[-1]) == flat(to_plain(Variant()))
    assert not RECIPES["recommended"].values


def test_every_departure_is_in_one_group() -> None:
    groups = [set(values) for _, values in DEPARTURE_GROUPS.values()]
    assert not any(one & other for one, other in combinations(groups, 2))
    assert set().union(*groups) == set(PRINTED)
    assert len(groups) <= 10


def test_rivals_and_lengths_have_every_setting_with_and_without_l_rad() -> None:
    for suite in (RIVALS, CONSISTENCY_LENGTH):
        by_others: dict[str, set[object]] = {}
        for row in suite.rows:
            values = values_of(row)
            weight = values.pop("radiometric_weight")
            by_others.setdefault(repr([values, row.budget]), set()).add(weight)
        alone = [weights for weights in by_others.values() if weights != {0.0, 0.2}]
        assert alone == ([{0.2}] * 2 if suite is RIVALS else [])


def test_a_row_whose_light_is_sought_has_no_other_light_in_its_place() -> None:
    for row in RIVALS.rows:
        values = values_of(row)
        deviations = values["deviations"]
        assert isinstance(deviations, list)
        sought = values["materials.start.light"] != "constant"
        assert not (sought and "start-light" in deviations), row.key
        assert sought == ("constant" not in row.text and (row.recipe != "printed" or "sought" in row.text))


def test_light_alone_differs_between_printed_and_a_light_that_is_sought() -> None:
    rows = {row.key: values_of(row) for row in RIVALS.rows}
    for key in ("printed-held", "printed-learnt"):
        changed = {name for name, value in rows[key].items() if value != rows["printed"][name]}
        assert changed <= {"materials.start.light", "deviations", "materials.rates.light"}
        left = set(rows["printed"]["deviations"]) - set(rows[key]["deviations"])  # type: ignore[call-overload]
        assert left == {"start-light"}
