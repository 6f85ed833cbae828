"""Scenes with complete ground truth from .blend files, path-traced by Blender Cycles (extra ``blend``)."""

from .request import Request
from .scene_folder import write_scene

__all__ = ["Request", "write_scene"]
