"""Whether stored values have the types that a TypedDict declares, all the way down."""

import sys
from collections.abc import Iterator
from functools import cache, partial
from itertools import islice
from types import NoneType, UnionType
from typing import Any, Literal, NotRequired, Required, Union, get_args, get_origin, get_type_hints, is_typeddict

MOST_COMPLAINTS = 3


def mismatch(value: object, kind: Any) -> str:
    """The first places where a value from JSON has another type than ``kind``, in words; empty where there are none.

    ``kind``: a TypedDict, a dict by names, a list, a union, a literal or a plain type. An int passes as float; a bool
    does not pass as a number, and neither does NaN or infinity. Keys that a TypedDict does not declare pass.
    """
    return "; ".join(islice(_complaints(value, kind, ""), MOST_COMPLAINTS))


def _complaints(value: object, kind: Any, where: str) -> Iterator[str]:
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return
    if origin in (NotRequired, Required):
        yield from _complaints(value, inner[0], where)
    elif is_typeddict(kind):
        yield from _of_table(value, kind, where)
    elif origin in (Union, UnionType):
        tried = [list(islice(_complaints(value, each, where), 1)) for each in inner]
        if all(tried):
            yield next(found[0] for each, found in zip(inner, tried, strict=True) if each is not NoneType)
    elif origin is Literal:
        if value not in inner or type(value) not in {type(each) for each in inner}:
            yield _wrong(where, value, f"one of {inner}")
    elif kind is dict or origin is dict:
        if not isinstance(value, dict):
            yield _wrong(where, value, "a table")
        elif inner:
            for name, each in value.items():
                yield from _complaints(each, inner[1], f"{where}.{name}")
    elif kind is list or origin is list:
        if not isinstance(value, list):
            yield _wrong(where, value, "a list")
        elif inner:
            for place, each in enumerate(value):
                yield from _complaints(each, inner[0], f"{where}[{place}]")
    elif kind is float and isinstance(value, int | float) and not isinstance(value, bool):
        if not abs(value) <= sys.float_info.max:  # also for NaN
            yield _wrong(where, value, NAMES[float])
    elif type(value) is not (NoneType if kind is None else kind):
        yield _wrong(where, value, NAMES.get(kind, str(kind)))


def _of_table(value: object, kind: Any, where: str) -> Iterator[str]:
    if not isinstance(value, dict):
        yield _wrong(where, value, "a table")
        return
    for name, of in _hints(kind).items():
        if name in value:
            yield from _complaints(value[name], of, f"{where}.{name}")
        elif name in kind.__required_keys__:
            yield f"{where.removeprefix('.') or 'it'} lacks '{name}'"


NAMES = {float: "a number", int: "a whole number", str: "text", bool: "true or false", NoneType: "null"}


_hints = cache(partial(get_type_hints, include_extras=True))


def _wrong(where: str, value: object, wanted: str) -> str:
    return f"{where.removeprefix('.') or 'it'} is {value!r:.40}, not {wanted}"
