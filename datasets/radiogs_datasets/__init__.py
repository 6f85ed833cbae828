"""Image files, scene loaders, generated ground truth and the committed miniatures."""

from .registry import load_scene, scene_names

__all__ = ["load_scene", "scene_names"]
