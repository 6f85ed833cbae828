"""Errors that explain themselves: what happened, why it matters, what to do next."""


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
