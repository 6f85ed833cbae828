"""Dataclasses from plain values: the types are the schema, and what is wrong is answered with its place."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

from radiogs.method import RADIOGS
from radiogs.settings import DEVIATIONS, Variant
from radiogs_core.errors import UsageError
from radiogs_core.plain_values import PlainReader, to_plain, with_values


@dataclass(frozen=True)
class Inner:
    rate: float = 0.5
    kind: Literal["a", "b"] = "a"


@dataclass(frozen=True)
class Outer:
    """Every form of field that a variant may have."""

    name: str
    count: int = 3
    on: bool = True
    inner: Inner = field(default_factory=Inner)
    several: tuple[Inner, ...] = ()
    pair: tuple[int, str] = (1, "x")
    names: tuple[str, ...] = ()
    either: Literal["all", "auto"] | tuple[str, ...] = "all"
    perhaps: int | None = None
    number_or_text: float | str = 0.0
    table: Mapping[str, float] = field(default_factory=dict)
    anything: Any = None

    def __post_init__(self) -> None:
        if self.count < 0:
            raise UsageError("count: below zero", "It counts.", "Leave it out.")


READER = PlainReader("variant of m", "See its fields.")


def read(**given: Any) -> Outer:
    made: Outer = READER.build(Outer, {"name": "n", **given}, "")
    return made


def test_fields_that_are_left_out_have_their_defaults() -> None:
    assert read() == Outer("n")


@pytest.mark.parametrize(
    ("given", "made"),
    [
        ({"inner": {"kind": "b"}}, {"inner": Inner(kind="b")}),
        ({"several": [{"rate": 1}, {}]}, {"several": (Inner(1.0), Inner())}),
        ({"pair": [2, "y"]}, {"pair": (2, "y")}),
        ({"names": ["p", "q"]}, {"names": ("p", "q")}),
        ({"either": "auto"}, {"either": "auto"}),
        ({"either": ["p"]}, {"either": ("p",)}),
        ({"either": []}, {"either": ()}),
        ({"perhaps": 4}, {"perhaps": 4}),
        ({"perhaps": None}, {"perhaps": None}),
        ({"number_or_text": "t"}, {"number_or_text": "t"}),
        ({"number_or_text": 2}, {"number_or_text": 2.0}),
        ({"table": {"p": 1}}, {"table": {"p": 1.0}}),
        ({"anything": [1, {"p": 2}]}, {"anything": [1, {"p": 2}]}),
    ],
)
def test_every_form_of_field_is_made_of_plain_values(given: dict[str, Any], made: dict[str, Any]) -> None:
    assert read(**given) == Outer("n", **made)
    assert read(**json.loads(json.dumps(given))) == Outer("n", **made)


@dataclass(frozen=True)
class Perhaps:
    inner: Inner | None = field(default_factory=Inner)


def test_a_nested_table_may_be_left_out_where_its_type_allows_nothing() -> None:
    without = Perhaps(None)
    assert with_values(Perhaps(), to_plain(without)) == without
    assert with_values(Perhaps(), {"inner.kind": "b"}) == Perhaps(Inner(kind="b"))
    assert with_values(without, to_plain(Perhaps())) == Perhaps()
    with pytest.raises(UsageError, match="inner"):
        with_values(Perhaps(), {"inner": 3})


def test_a_whole_number_for_a_real_one_becomes_real() -> None:
    """Else 1 and 1.0 would be two cells of one variant."""
    made = read(inner={"rate": 1})
    assert type(made.inner.rate) is float
    assert json.dumps(to_plain(made)) == json.dumps(to_plain(read(inner={"rate": 1.0})))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"cuont": 1}, "variant of m: there is no field 'cuont'\nDid you mean 'count'?"),
        ({"zzz": 1}, "variant of m: there is no field 'zzz'\nThere are: name, count"),
        ({"inner": {"knid": "a"}}, "variant of m: inner: there is no field 'knid'\nDid you mean 'kind'?"),
        ({"inner": {"kind": "c"}}, "variant of m: inner.kind: 'c' is none of its values\nThere are: 'a', 'b'."),
        ({"inner": 3}, "variant of m: inner: 3 is no table"),
        ({"several": [{}, {"rate": "x"}]}, "several[1].rate: 'x' is not a number"),
        ({"pair": [1]}, "pair: [1] is not a list of 2"),
        ({"pair": [1, 2]}, "pair[1]: 2 is not text"),
        ({"names": "p"}, "names: 'p' is not a list"),
        ({"names": [1]}, "names[0]: 1 is not text"),
        ({"either": "some"}, "either: 'some' is none of its values"),
        ({"either": [1]}, "either[0]: 1 is not text"),
        ({"perhaps": "x"}, "perhaps: 'x' is not a whole number"),
        ({"number_or_text": [1]}, "number_or_text: [1] is not a number or text"),
        ({"count": True}, "count: True is not a whole number"),
        ({"count": 1.0}, "count: 1.0 is not a whole number"),
        ({"on": 1}, "on: 1 is not true or false"),
        ({"table": {"p": "x"}}, "table.p: 'x' is not a number"),
        ({"table": []}, "table: [] is not a table"),
        ({"inner": {"rate": float("inf")}}, "inner.rate: inf is not a finite number"),
        ({"inner": {"rate": 10**400}}, "inner.rate: 1"),
        ({"count": -1}, "variant of m: count: below zero\nIt counts.\nLeave it out."),
    ],
)
def test_wrong_values_are_refused_with_the_path_of_their_field(given: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError) as caught:
        read(**given)
    assert says in str(caught.value)
    assert caught.value.remedy


def test_a_field_without_a_default_is_asked_for() -> None:
    with pytest.raises(UsageError, match="variant of m: it lacks 'name'"):
        READER.build(Outer, {}, "")


@pytest.mark.parametrize(
    "variant",
    [Variant(), Variant(effects="auto"), Variant(effects=("visibility",)), Variant(deviations=tuple(DEVIATIONS))],
)
def test_a_variant_comes_back_from_what_is_stored_of_it(variant: Variant) -> None:
    assert READER.build(RADIOGS.variant, json.loads(json.dumps(to_plain(variant))), "") == variant
