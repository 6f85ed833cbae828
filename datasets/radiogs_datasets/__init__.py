"""Image files, scene loaders, generated ground truth and the committed miniatures.

Loaders are imported when they are first used: they need PyTorch, which names of scenes do not.
"""

from typing import TYPE_CHECKING, Any

from .data_root import scene_names

if TYPE_CHECKING:
    from .registry import known_names, load_scene, scene_choices, scene_kind

__all__ = ["known_names", "load_scene", "scene_choices", "scene_kind", "scene_names"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import registry

    return getattr(registry, name)
