"""Conversion of plain values (TOML, JSON) to dataclasses and back; errors name the field and the problem."""

import json
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass, replace
from types import UnionType
from typing import Any, Literal, NoReturn, Union, get_args, get_origin, get_type_hints

from .errors import UsageError, did_you_mean

WORDS: Mapping[Any, str] = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    type(None): "nothing",
    tuple[str, ...]: "a list of text",
}
"""Names of types in error messages."""

Convert = Callable[[Any, str], Any]
"""Makes a value of some type from a plain one; the second argument is its dotted name in the file, for errors."""


class PlainReader:
    """Builds dataclasses from tables of plain values; the dataclasses are the schema.

    Every message begins with ``source`` and ends with ``remedy``. ``special``: converters for types that need their
    own. In all methods, ``where`` is the dotted name of the value, for errors; all errors are UsageError.
    """

    def __init__(self, source: str, remedy: str, special: Mapping[Any, Convert] | None = None) -> None:
        self.source, self.remedy, self.special = source, remedy, dict(special or {})

    def fail(self, where: str, what: str, why: str = "", remedy: str = "") -> NoReturn:
        """Raises UsageError with ``source``, ``where`` and ``what`` in its first line."""
        raise UsageError(": ".join(part for part in (self.source, where, what) if part), why, remedy or self.remedy)

    def known(self, where: str, kind: str, given: str, names: Mapping[str, object] | tuple[str, ...]) -> None:
        """Raises UsageError, with the nearest name, unless ``given`` is one of ``names``."""
        if given not in names:
            hint = did_you_mean(given, names) or f"There are: {', '.join(names)}."
            self.fail(where, f"there is no {kind} '{given}'", hint)

    def expect(self, holds: bool, where: str, value: Any, wanted: str) -> None:
        """Raises UsageError that ``value`` is not ``wanted`` (such as "a number"), unless ``holds``."""
        if not holds:
            self.fail(where, f"{value!r} is not {wanted}")

    def build(self, kind: type, table: object, where: str) -> Any:
        """An instance of the dataclass ``kind`` from a table of its fields; fields with a default may be missing.

        Raises UsageError for an unknown field, for all missing ones, and for a value that is refused.
        """
        if not isinstance(table, Mapping):
            self.fail(where, f"{table!r} is no table", "It has fields of its own.")
        hints, declared = get_type_hints(kind), {each.name: each for each in fields(kind)}
        for name in table:
            self.known(where, "field", name, declared)
        required = [name for name, each in declared.items() if each.default is each.default_factory is MISSING]
        if missing := [f"'{name}'" for name in required if name not in table]:
            self.fail(where, f"it lacks {', '.join(missing)}")
        prefix = f"{where}." if where else ""
        values = {name: self.convert(hints[name], value, f"{prefix}{name}") for name, value in table.items()}
        try:
            return kind(**values)
        except UsageError as refused:  # raised by the dataclass itself, which does not know ``where``
            self.fail(where, refused.what, refused.why, refused.remedy)

    def change(self, instance: Any, values: object, where: str) -> Any:
        """A copy of a dataclass with some fields changed: by name, by dotted name, or by a table for a nested one.

        Raises UsageError as ``build`` does, and for a field that is changed twice.
        """
        if not isinstance(values, Mapping):
            self.fail(where, f"{values!r} is no table", f"It has fields of its own: {', '.join(leaf_names(instance))}.")
        prefix = f"{where}." if where else ""
        hints, names = get_type_hints(type(instance)), [each.name for each in fields(instance)]
        changed: dict[str, Any] = {}
        below: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            field, _, rest = name.partition(".")
            nested = is_dataclass(getattr(instance, field, None))
            if field not in names or (rest and not nested):
                self.known(where, "field", name, tuple(leaf_names(instance)))
            if not nested:
                changed[field] = self.convert(hints[field], value, f"{prefix}{field}")
            elif rest or isinstance(value, Mapping):
                table = {rest: value} if rest else value
                for twice in below.setdefault(field, {}).keys() & table.keys():
                    self.fail(where, f"{field}.{twice} is given twice")
                below[field].update(table)
            elif get_origin(hints[field]) in (Union, UnionType):  # such as None, where the type allows it
                changed[field] = self.convert(hints[field], value, f"{prefix}{field}")
            else:
                self.change(getattr(instance, field), value, f"{prefix}{field}")  # raises: ``value`` is no table
        for field, table in below.items():
            changed[field] = self.change(getattr(instance, field), table, f"{prefix}{field}")
        try:
            return replace(instance, **changed)
        except UsageError as refused:
            self.fail(where, refused.what, refused.why, refused.remedy)

    def convert(self, hint: Any, value: Any, where: str) -> Any:
        """The value as an instance of the type ``hint``. Raises UsageError if it cannot be converted."""
        origin, arguments = get_origin(hint), get_args(hint)
        if hint in self.special:
            return self.special[hint](value, where)
        if is_dataclass(hint) and isinstance(hint, type):
            return self.build(hint, value, where)
        if origin is Literal:
            if value not in arguments:
                self.fail(where, f"{value!r} is none of its values", f"There are: {', '.join(map(repr, arguments))}.")
            return value
        if origin in (Union, UnionType):
            return self._one_of(arguments, value, where)
        if origin is tuple:
            self.expect(isinstance(value, list | tuple), where, value, "a list")
            every = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
            self.expect(len(every) == len(value), where, value, f"a list of {len(every)}")
            entries = enumerate(zip(every, value, strict=True))
            return tuple(self.convert(entry, each, f"{where}[{index}]") for index, (entry, each) in entries)
        if origin is not None and issubclass(origin, Mapping):
            self.expect(isinstance(value, Mapping), where, value, "a table")
            return {name: self.convert(arguments[1], each, f"{where}.{name}") for name, each in value.items()}
        if hint is Any:
            return value
        if hint is float:
            self.expect(isinstance(value, int | float) and not isinstance(value, bool), where, value, "a number")
            self.expect(abs(value) <= sys.float_info.max, where, value, "a finite number")
            return float(value)
        self.expect(type(value) is hint, where, value, WORDS.get(hint, str(hint)))
        return value

    def _one_of(self, arguments: tuple[Any, ...], value: Any, where: str) -> Any:
        """The value as the first type of a union that accepts it.

        If only one type of the union agrees with the value in being a list, or not, the error of that type is raised.
        """
        if value is None and type(None) in arguments:
            return None
        shaped = [each for each in arguments if (get_origin(each) is tuple) == isinstance(value, list | tuple)]
        if len(shaped) == 1:
            return self.convert(shaped[0], value, where)
        for each in shaped:
            try:
                return self.convert(each, value, where)
            except UsageError:
                continue
        self.fail(where, f"{value!r} is not {' or '.join(WORDS.get(each, str(each)) for each in arguments)}")


def from_plain(kind: type, values: Mapping[str, Any], what: str) -> Any:
    """An instance of the dataclass ``kind`` from plain values. Raises UsageError that names ``what`` and the field."""
    return PlainReader(what, "See its fields:  radiogs-bench methods").build(kind, values, "")


def with_values(instance: Any, values: Mapping[str, Any], what: str = "settings") -> Any:
    """A copy of a dataclass with some fields changed to plain values, by dotted names or by nested tables.

    Raises UsageError that names ``what`` and the field: for an unknown field, with the nearest name; for a value of
    another type; and for a value that the dataclass refuses.
    """
    return PlainReader(what, "See its fields:  radiogs-bench methods").change(instance, values, "")


def leaf_names(instance: Any) -> list[str]:
    """Dotted names of a dataclass's fields; a nested dataclass is replaced by the names of its own fields."""
    names: list[str] = []
    for each in fields(instance):
        value = getattr(instance, each.name)
        names += [f"{each.name}.{name}" for name in leaf_names(value)] if is_dataclass(value) else [each.name]
    return names


def value_at(instance: Any, name: str) -> Any:
    """The value of a field by its dotted name."""
    for part in name.split("."):
        instance = getattr(instance, part)
    return instance


RANGES: Mapping[str, Callable[[float], bool]] = {
    "zero or above": lambda value: value >= 0,
    "above zero": lambda value: value > 0,
    "one or above": lambda value: value >= 1,
    "two or above": lambda value: value >= 2,
    "between 0 and 1": lambda value: 0 <= value <= 1,
    "above 0 and at most 1": lambda value: 0 < value <= 1,
    "above 0 and below 1": lambda value: 0 < value < 1,
}
"""Ranges of settings, in the words of the message about a value outside; a value that is not a number lies in none."""


def require(settings: Any, wanted: str, *names: str) -> None:
    """Check that fields of a dataclass lie in one of RANGES; of a list, every entry. None passes.

    Raises UsageError that names the field and its value.
    """
    for name in names:
        value = getattr(settings, name)
        for each in value if isinstance(value, tuple) else (value,):
            if each is not None and not (_is_finite(each) and RANGES[wanted](each)):
                raise UsageError(f"{name}: {each} is not {wanted}")


@dataclass(frozen=True)
class NotNegative:
    """Numbers that are zero or above, such as the weights of losses. Raises UsageError for any other number."""

    def __post_init__(self) -> None:
        require(self, "zero or above", *(each.name for each in fields(self)))


def _is_finite(number: Any) -> bool:
    try:
        return math.isfinite(number)
    except OverflowError:  # a whole number beyond float64
        return False


def to_plain(value: Any) -> dict[str, Any]:
    """A dataclass's fields after a round trip through JSON, equal to a stored result's fields.

    Raises ValueError for a value that is not finite.
    """
    plain: dict[str, Any] = json.loads(json.dumps(asdict(value), allow_nan=False))
    return plain


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as one flat table, with dotted names.

    >>> flat({"weights": {"normal": 0.05}, "seed": 1})
    {'weights.normal': 0.05, 'seed': 1}
    """
    dotted: dict[str, Any] = {}
    for name, value in values.items():
        dotted |= flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return dotted
