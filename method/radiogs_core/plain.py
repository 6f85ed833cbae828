"""Frozen dataclasses from the plain values that a file keeps of them: nested tables, and lists for tuples."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from typing import Any, TypeVar, get_type_hints

from .errors import UsageError

Kind = TypeVar("Kind")


def from_plain(kind: type[Kind], values: Mapping[str, Any]) -> Kind:
    """The inverse of ``dataclasses.asdict`` after JSON; fields that are not given have their defaults.

    Raises UsageError for a name that is none of the fields.
    """
    assert is_dataclass(kind)
    names, hints = [each.name for each in fields(kind)], get_type_hints(kind)
    made: dict[str, Any] = {}
    for name, value in values.items():
        if name not in names:
            near = get_close_matches(name, names, 1)
            raise UsageError(
                f"{kind.__name__} has no field '{name}'",
                f"Did you mean '{near[0]}'?" if near else "",
                f"Fields: {', '.join(names)}.",
            )
        if isinstance(value, Mapping) and is_dataclass(hints[name]):
            made[name] = from_plain(hints[name], value)
        else:
            made[name] = tuple(value) if isinstance(value, list) else value
    return kind(**made)
