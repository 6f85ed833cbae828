"""Image files, scene loaders, generated ground truth and the committed miniatures."""

from .registry import known_names, load_scene, scene_choices, scene_kind, scene_names

__all__ = ["known_names", "load_scene", "scene_choices", "scene_kind", "scene_names"]
