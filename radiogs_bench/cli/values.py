"""Reads values of options from text. Each function raises ValueError for an invalid text."""

import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from cyclopts import CoercionError, Parameter, Token, convert

from ..trusted_methods import SUFFIX

SMALLEST_PICTURE, LARGEST_PICTURE = 16, 8192
"""Pixels a side: VTK aborts the process for buffers of about 16384 pixels."""

BARE_WORD = re.compile(r"[A-Za-z][\w.+-]*")
"""A value of ``--set`` that needs no quotes."""

LONGEST_COUNT = 18
"""Most digits of a whole number: every number of so many digits fits into 64 bits."""


def read(kind: Any, tokens: Sequence[Token]) -> Any:
    """The value of an option of a given type, from the last of its texts; lists are separated by commas."""
    text = tokens[-1].value
    if get_origin(kind) in (Union, UnionType):
        kinds = [each for each in get_args(kind) if each is not NoneType]
        kind = str if str in kinds else kinds[0]
    if kind == tuple[str, ...]:
        return names(text)
    if kind in (str, Path):
        return kind(text)
    if kind is int:
        return whole(text)
    return finite(text) if kind is float else convert(kind, tokens[-1:])


def from_text(of: Callable[[str], Any]) -> Parameter:
    """An option whose value is made from the last text that it was given."""
    return Parameter(converter=lambda kind, tokens: value_of(tokens[-1], of), n_tokens=1)


def from_every_text(of: Callable[[str], Any]) -> Parameter:
    """An option that may be repeated, with a value for each text."""
    return Parameter(converter=lambda kind, tokens: tuple(value_of(each, of) for each in tokens), n_tokens=1)


def value_of(token: Token, of: Callable[[str], Any]) -> Any:
    """The value of a text. Raises an error of the parser that names the option."""
    try:
        return of(token.value)
    except ValueError as error:
        raise CoercionError(msg=str(error), token=token) from error


def names(text: str) -> tuple[str, ...]:
    """A list separated by commas."""
    return tuple(name for name in text.split(",") if name)


def whole(text: str) -> int:
    """A whole number."""
    if not text.removeprefix("-").isdecimal() or len(text) > LONGEST_COUNT:
        raise ValueError(f"'{text}' is not a whole number")
    return int(text)


def finite(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is not a finite number")
    return value


def factor(text: str) -> float:
    """A finite number above zero."""
    value = finite(text)
    if value <= 0:
        raise ValueError(f"'{text}' is not a number above zero")
    return value


def positive(text: str) -> int:
    """A whole number above zero."""
    if not text.isdecimal() or len(text) > LONGEST_COUNT or int(text) < 1:
        raise ValueError(f"'{text}' is not a whole number above zero")
    return int(text)


def views_kept(text: str) -> int:
    """A whole number, or ``all``."""
    if text == "all":
        return sys.maxsize
    if not text.isdecimal() or len(text) > LONGEST_COUNT:
        raise ValueError(f"'{text}' is neither a whole number nor 'all'")
    return int(text)


def differences(text: str) -> dict[str, float]:
    """Sizes of differences by column, such as nvs/psnr=0.5,albedo/psnr=0.3."""
    found = {}
    for each in names(text):
        column, _, size = each.partition("=")
        try:
            found[column] = factor(size)
        except ValueError:
            raise ValueError(f"'{each}' is not COLUMN=SIZE with a size above zero, such as albedo/psnr=0.3") from None
    return found


def pixels(text: str) -> int:
    """Number of pixels on each side of a picture."""
    if not SMALLEST_PICTURE <= positive(text) <= LARGEST_PICTURE:
        raise ValueError(f"'{text}' is not between {SMALLEST_PICTURE} and {LARGEST_PICTURE} pixels")
    return positive(text)


def part_of(text: str) -> tuple[int, int]:
    """A part and the number of parts, such as 0/2."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal() and int(number) < int(count)):
        raise ValueError(f"'{text}' is not a part such as 0/2")
    return int(number), int(count)


def effects(text: str) -> str | tuple[str, ...]:
    """``all``, ``auto``, or a list of effects separated by commas; ``none`` is the empty list."""
    from radiogs_core.transport.plan import checked_effects

    if text in ("all", "auto"):
        return text
    return checked_effects(() if text == "none" else names(text))


def setting(text: str) -> tuple[str, Any]:
    """FIELD=VALUE: a dotted name and a value, which is TOML (``0.01``, ``["a"]``) or a bare word (``auto``)."""
    import tomllib

    name, sign, written = text.partition("=")
    name, written = name.strip(), written.strip()
    if not sign or not all(part.isidentifier() for part in name.split(".")):
        raise ValueError(f"'{text}' is not FIELD=VALUE, such as materials.rates.light=0.01")
    try:
        read = tomllib.loads(f"value = {written}")
    except (ValueError, RecursionError):
        if not BARE_WORD.fullmatch(written):
            raise ValueError(f"'{written}' of {name} is neither TOML nor a single word") from None
        return name, written
    if read.keys() != {"value"}:
        raise ValueError(f"'{written}' of {name} is more than one value")
    return name, read["value"]


def method_file(text: str) -> str:
    """The path of a method's file."""
    if not text.endswith(SUFFIX):
        raise ValueError(f"'{text}' does not end in {SUFFIX}, as methods' files do")
    return text
