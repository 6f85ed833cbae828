"""The page's own files: templates, scripts, styles."""

from importlib import resources
from importlib.resources.abc import Traversable


def part(*path: str) -> str:
    """Text of a file in this module's folder."""
    place: Traversable = resources.files(__package__)
    return place.joinpath(*path).read_text(encoding="utf-8")
