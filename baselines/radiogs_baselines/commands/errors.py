"""The error of a command that failed."""

from radiogs_core.errors import ExplainedError


class CommandFailed(ExplainedError):
    """A command could not be started, failed, exceeded its time limit, or did not write all files that it should."""
