"""Exit codes, and errors that only the harness raises."""

from collections.abc import Iterable

from radiogs_core.errors import DataError, ExplainedError, NumericalFailure, UsageError


class CellFailed(ExplainedError):
    """A cell failed."""


class MethodFailed(ExplainedError):
    """A method raised an unexplained exception, or returned a value that breaks its contract.

    ``trace`` is the whole traceback, empty if nothing was raised.
    """

    def __init__(self, what: str, why: str = "", remedy: str = "", trace: str = "") -> None:
        super().__init__(what, why, remedy)
        self.trace = trace


class StoreError(ExplainedError):
    """The store cannot be read or written; what was finished before is untouched."""


class Killed(ExplainedError):
    """Processes that ran cells were killed, and their cells are left unfinished."""


class NotFetched(ExplainedError):
    """Files of a data set could not be fetched; the message lists what to fetch by hand, and where to put it."""


class Unforeseen(MethodFailed):
    """A cell ended with an unexpected error; the others went on."""


class StoppedAtOnce(KeyboardInterrupt):
    """The user asked twice to stop. A KeyboardInterrupt raised by a method's own code does not count."""


class Interrupted(ExplainedError):
    """The user requested a stop; everything finished so far is on disk."""


DONE = 0

UNEXPECTED = 6
"""Exit code for everything but a failed cell or a regression: an unreadable or unwritable folder, a killed process, or
an unforeseen error."""

EXIT_CODES: tuple[tuple[type[ExplainedError], int], ...] = (
    (Interrupted, 130),  # 128 + SIGINT, as shells report it
    (NumericalFailure, 4),
    (NotFetched, 5),
    (DataError, 3),
    (StoreError, UNEXPECTED),
    (Killed, UNEXPECTED),
    (Unforeseen, UNEXPECTED),
    (UsageError, 2),
    (ExplainedError, 1),
)
"""Exit codes by class of error, most severe first: the first class that an error is an instance of decides."""


def exit_code(error: ExplainedError) -> int:
    """The process's exit code for an error."""
    return next(code for kind, code in EXIT_CODES if isinstance(error, kind))


def worst_exit_code(errors: Iterable[ExplainedError]) -> int:
    """The exit code of a run with these errors: the most severe one's; 0 without errors."""
    severity = [code for _, code in EXIT_CODES]
    return min((exit_code(error) for error in errors), key=severity.index, default=DONE)


def explain(error: ExplainedError) -> str:
    """The error message: what happened, why, and what to do next, each on lines of its own."""
    what = error.what if isinstance(error, Interrupted) else f"error: {error.what}"
    parts = [visible(part) for part in (what, error.why, error.remedy) if part]
    return "\n".join([*parts, f"(exit code {exit_code(error)})"])


def visible(text: str) -> str:
    """The text with control and bidirectional characters escaped; line breaks stay.

    >>> visible("a\x1b[2J")
    'a\\x1b[2J'
    """
    return "".join(
        each if each in "\n\t" or each.isprintable() else each.encode("unicode_escape").decode() for each in text
    )
