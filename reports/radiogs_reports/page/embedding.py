"""Embeds data and code so that a name of a scene or row cannot become markup or code."""

import base64
import hashlib
import json
from typing import Any

from markupsafe import Markup

ESCAPED = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
"""Characters that could end a script element or start a comment in it; in JSON they occur in strings only."""


def json_for_script(content: Any) -> Markup:
    """Strict JSON, keys in their given order, that is safe inside <script type="application/json">."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character, escape in ESCAPED.items():
        text = text.replace(character, escape)
    return Markup(text)


def source_hash(source: str) -> str:
    """The source expression by which a content security policy allows an inline script or style."""
    digest = hashlib.sha256(source.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def content_security_policy(script: str, style: str, files: bool = False) -> str:
    """A policy that allows this script, this style and embedded pictures, and no request.

    ``files``: pictures of the page's own place as well, on a disk or a server. A second defence: a name that became
    markup could neither run nor send anything.
    """
    pictures = "data: 'self' file:" if files else "data:"
    return (
        f"default-src 'none'; base-uri 'none'; form-action 'none'; img-src {pictures}; "
        f"script-src {source_hash(script)}; style-src {source_hash(style)}"
    )
