"""The page's own files, templates, scripts and styles, and what is embedded so that no name becomes markup or code."""

import base64
import hashlib
import json
from collections.abc import Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup, escape

from ..wording import SYMBOL

ESCAPED = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
"""Characters that could end a script element or start a comment in it; in JSON they occur in strings only."""


FILES: Traversable = resources.files(__package__)

VIEWER = ("surfel_data", "light_maps", "turning", "gpu", "shading", "drawing", "surfels")
"""The scripts of the viewer of surfels, in the order in which they run."""

MAPS = ("city", "studio", "sunset")
"""Maps of light that the viewer of surfels offers, by Poly Haven (CC0), 32 x 64 texels: ``lights/<name>.hdr``."""


def json_for_script(content: Any) -> Markup:
    """Strict JSON, keys in their given order, that is safe inside <script type="application/json">."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character, code in ESCAPED.items():
        text = text.replace(character, code)
    return Markup(text)


def part(*path: str) -> str:
    """Text of a file in this module's folder."""
    return FILES.joinpath(*path).read_text(encoding="utf-8")


def scripts(names: Sequence[str]) -> str:
    """Scripts of these names, in the order in which they run."""
    return "\n".join(part("script", f"{name}.js") for name in names)


def styles(names: Sequence[str]) -> str:
    """Style sheets of these names."""
    return "\n".join(part("style", f"{name}.css") for name in names)


def rendered(template: str, script: str, style: str, files: bool = False, **values: Any) -> str:
    """A page by its template; names of scenes and rows are escaped, and a name that is not given is an error.

    Its content security policy allows this script, this style and embedded pictures, and no request. ``files``:
    pictures of the page's own place as well, on a disk or a server. This is a second defence: even a name that became
    markup could not run or send anything.
    """
    made = Environment(
        loader=FunctionLoader(lambda name: part("templates", name)),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["formula"] = formula
    lights = {name: base64.b64encode(FILES.joinpath("lights", f"{name}.hdr").read_bytes()).decode() for name in MAPS}
    made.globals |= {"json_for_script": json_for_script, "maps_of_light": lights}
    digests = (hashlib.sha256(each.encode("utf-8")).digest() for each in (script, style))
    of_script, of_style = (base64.b64encode(digest).decode("ascii") for digest in digests)
    sources = " 'self' file:" if files else ""
    policy = (
        f"default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:{sources}; "
        f"script-src 'sha256-{of_script}'; style-src 'sha256-{of_style}'"
    )
    return made.get_template(template).render(policy=policy, script=Markup(script), style=Markup(style), **values)


def formula(text: str) -> Markup:
    """Plain text as HTML, with indices and exponents set as such.

    >>> formula("λ_rad < L_G^PBR")
    Markup('<i>λ</i><sub>rad</sub> &lt; <i>L</i><sub>G</sub><sup>PBR</sup>')
    """
    made = SYMBOL.sub(r"<i>\1</i><sub>\2</sub><sup>\3</sup>", str(escape(text)))  # a symbol has letters alone
    return Markup(made.replace("<sup></sup>", ""))
