"""pyvista, which reads meshes and measures distances from them: 590 MB with VTK, and few commands need it."""

from typing import Any

from ...extras import extra_library


def pyvista() -> Any:
    """The library. Raises UsageError where it is not installed."""
    return extra_library("pyvista", "meshes and windows need pyvista", "meshes")
