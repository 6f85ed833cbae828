"""The failure that only a command can have."""

from radiogs_core.errors import ExplainedError


class CommandFailed(ExplainedError):
    """A command could not be started, ended badly, took too long, or left out what it should have written."""
