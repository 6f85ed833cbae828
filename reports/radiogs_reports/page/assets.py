"""The page's own files: templates, scripts, styles."""

from collections.abc import Sequence
from importlib import resources
from importlib.resources.abc import Traversable

from jinja2 import Environment, FunctionLoader, StrictUndefined

from .formula import formula


def part(*path: str) -> str:
    """Text of a file in this module's folder."""
    place: Traversable = resources.files(__package__)
    return place.joinpath(*path).read_text(encoding="utf-8")


def scripts(names: Sequence[str]) -> str:
    """Scripts of these names, in the order in which they run."""
    return "\n".join(part("script", f"{name}.js") for name in names)


def styles(names: Sequence[str]) -> str:
    """Style sheets of these names."""
    return "\n".join(part("style", f"{name}.css") for name in names)


def templates() -> Environment:
    """The templates; names of scenes and rows are escaped, and a name that is not given is an error."""
    made = Environment(
        loader=FunctionLoader(lambda name: part("templates", name)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["formula"] = formula
    return made
