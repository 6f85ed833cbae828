"""Libraries that few commands need: extras of the package, imported when they are asked for."""

from importlib import import_module
from typing import Any

from radiogs_core.errors import UsageError


def extra_library(module: str, needed_for: str, extra: str, otherwise: str = "") -> Any:
    """Import an extra library. Raises UsageError if it is not installed.

    ``needed_for``: what needs which library ("parquet needs pyarrow"). ``extra``: the extra of the package that
    installs it. ``otherwise``: what else can be done, after the command.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise UsageError(
            f"{needed_for}, which is not installed",
            str(error).splitlines()[0],
            f"pip install 'radiogs-bench[{extra}]'{otherwise}",
        ) from error
