"""The page's own files, templates, scripts and styles, and the symbols of labels as HTML."""

from collections.abc import Sequence
from importlib import resources
from importlib.resources.abc import Traversable

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup, escape

from ..wording import SYMBOL


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


def formula(text: str) -> Markup:
    """Plain text as HTML, with indices and exponents set as such.

    >>> formula("λ_rad < L_G^PBR")
    Markup('<i>λ</i><sub>rad</sub> &lt; <i>L</i><sub>G</sub><sup>PBR</sup>')
    """
    parts = SYMBOL.split(text)
    made = escape(parts[0])
    for symbol, lower, upper, rest in zip(parts[1::4], parts[2::4], parts[3::4], parts[4::4], strict=True):
        raised = Markup("") if upper is None else Markup("<sup>{}</sup>").format(upper)
        made += Markup("<i>{}</i><sub>{}</sub>{}").format(symbol, lower, raised) + escape(rest)
    return made
