"""pyvista, imported where meshes are read or a window is opened: few commands need it, and VTK loads slowly."""

from importlib import import_module
from typing import Any

from radiogs_core.errors import UsageError


def pyvista() -> Any:
    """The library. Raises UsageError where it cannot be loaded: VTK needs graphics libraries of the system."""
    try:
        return import_module("pyvista")
    except ImportError as error:
        raise UsageError(
            "meshes and windows need pyvista, which cannot be loaded",
            str(error).splitlines()[0],
            "Install what it names. VTK needs, on Debian:  apt-get install libgl1 libegl1 libxrender1",
        ) from error
