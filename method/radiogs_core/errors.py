"""Errors that explain themselves: what happened, why it matters, what to do next."""

from collections.abc import Iterable
from difflib import get_close_matches


class ExplainedError(Exception):
    """A failure whose message a user can act on.

    ``what`` names the thing and the value; ``why`` says why that is wrong; ``remedy`` says what to do next.
    """

    def __init__(self, what: str, why: str = "", remedy: str = "") -> None:
        self.what = what
        self.why = why
        self.remedy = remedy
        super().__init__("\n".join(part for part in (what, why, remedy) if part))


class DataError(ExplainedError):
    """A file or a scene is missing or malformed."""


class UsageError(ExplainedError):
    """The caller asked for something that does not exist or does not fit together."""


class NumericalFailure(ExplainedError):
    """A non-finite value appeared where every value must be finite."""


def unknown(kind: str, name: str, names: Iterable[str], remedy: str = "", of: str = "") -> UsageError:
    """The error for a name that does not exist, with the nearest name that does; where none is near, with all of them.

    ``of`` is what the names belong to, such as a method. Without a ``remedy``, all names stand in its place.

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
    """A question with the name that is nearest; empty where none is near.

    The last part of a dotted name, such as ``light`` of ``rates.light``, is near to the whole.

    >>> did_you_mean("tinny", ["smoke", "tiny"]), did_you_mean("x", ["smoke", "tiny"])
    ("Did you mean 'tiny'?", '')
    """
    existing = list(names)
    near = [each for each in existing if each.endswith(f".{name}")] or get_close_matches(name, existing, 1)
    return f"Did you mean {' or '.join(map(repr, near))}?" if near else ""
