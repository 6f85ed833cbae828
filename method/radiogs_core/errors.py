"""Errors in three parts: what happened, why it is wrong, and what to do next."""

from collections.abc import Iterable
from difflib import get_close_matches


class ExplainedError(Exception):
    """An error whose message includes the next step to take.

    ``what`` names the object and the value; ``why`` gives the reason; ``remedy`` gives the next step. Each is one line
    of the message, and an empty one is left out.
    """

    def __init__(self, what: str, why: str = "", remedy: str = "") -> None:
        self.what = what
        self.why = why
        self.remedy = remedy
        super().__init__("\n".join(part for part in (what, why, remedy) if part))


class DataError(ExplainedError):
    """A file or a scene is missing or malformed."""


class UsageError(ExplainedError):
    """A name that does not exist, or values that do not fit together."""


class NumericalFailure(ExplainedError):
    """A non-finite value appeared where every value must be finite."""


def unknown(kind: str, name: str, names: Iterable[str], remedy: str = "", of: str = "") -> UsageError:
    """The error for a name that does not exist: it lists the nearest name, or all names if none is near.

    ``of``: the owner of the names, such as a method. Without a ``remedy``, the last line lists all names.

    >>> print(unknown("preset", "tinny", ["smoke", "tiny"], of="irgs"))
    unknown preset 'tinny' of irgs
    Did you mean 'tiny'?
    There are: smoke, tiny.
    """
    existing = list(names)
    owner, every = (f" of {of}" if of else ""), f"There are: {', '.join(existing)}."
    why = did_you_mean(name, existing) or (every if remedy else "")
    return UsageError(f"unknown {kind} '{name}'{owner}", why, remedy or every)


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """The question "Did you mean ...?" with the nearest name; empty if no name is near.

    A name is near to every dotted name that ends with it, such as ``light`` to ``rates.light``.

    >>> did_you_mean("tinny", ["smoke", "tiny"]), did_you_mean("x", ["smoke", "tiny"])
    ("Did you mean 'tiny'?", '')
    """
    existing = list(names)
    near = [each for each in existing if each.endswith(f".{name}")] or get_close_matches(name, existing, 1)
    return f"Did you mean {' or '.join(map(repr, near))}?" if near else ""
