"""Path-traced scenes with complete ground truth, made with Mitsuba 3 (extra ``generate``)."""

from .scene_folder import generate_scene

__all__ = ["generate_scene"]
