"""A benchmark harness for inverse rendering: from Python by the names below, from the shell as ``radiogs-bench``."""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api import (
        Model,
        PreparedModel,
        load_scene,
        method,
        method_names,
        open_model,
        open_store,
        protocol_names,
        read_lamps,
        read_light,
        scene_names,
        train,
    )
    from .whole_runs import RunSpec, gate, run, table

__version__ = version("radiogs-bench")

__all__ = [
    "Model",
    "PreparedModel",
    "RunSpec",
    "__version__",
    "gate",
    "load_scene",
    "method",
    "method_names",
    "open_model",
    "open_store",
    "protocol_names",
    "read_lamps",
    "read_light",
    "run",
    "scene_names",
    "table",
    "train",
]


def __getattr__(name: str) -> Any:
    """Names of the API, imported when they are first asked for: the command line answers without PyTorch."""
    if name in __all__:
        from . import api, whole_runs

        return getattr(api if name in api.__all__ else whole_runs, name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__() -> list[str]:
    """The names of the API, for completion and ``help``."""
    return sorted(__all__)
