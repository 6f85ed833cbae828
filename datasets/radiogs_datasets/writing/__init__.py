"""Writing a scene in another layout, and saying what that layout cannot carry."""

from .convert import LAYOUTS, convert

__all__ = ["LAYOUTS", "convert"]
