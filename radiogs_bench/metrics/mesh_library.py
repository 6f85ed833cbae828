"""pyvista, which reads meshes and measures distances from them: 590 MB with VTK, and few commands need it."""

from typing import Any

from radiogs_core.errors import UsageError


def pyvista() -> Any:
    """The library. Raises UsageError where it is not installed."""
    try:
        import pyvista as library
    except ImportError as error:
        raise UsageError(
            "meshes and windows need pyvista, which is not installed",
            f"{error}".splitlines()[0],
            "pip install 'radiogs-bench[meshes]'",
        ) from error
    return library
