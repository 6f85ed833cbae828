"""Putting data and code into a page so that no name of a scene or a row can become part of either."""

import base64
import hashlib
import json
from typing import Any

from markupsafe import Markup

ESCAPED = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
"""What could end a script element or start a comment in it; in JSON these occur in strings only."""


def json_for_script(content: Any) -> Markup:
    """Strict JSON, keys in their own order, that is safe inside <script type="application/json">."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character, escape in ESCAPED.items():
        text = text.replace(character, escape)
    return Markup(text)


def source_hash(source: str) -> str:
    """How a content security policy names an inline script or style that it lets pass."""
    digest = hashlib.sha256(source.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def content_security_policy(script: str, style: str) -> str:
    """Nothing from anywhere but pictures inside the page, and this one script and style: a name that slipped through
    as markup could neither run nor send anything.
    """  # fmt: skip
    return (
        "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; "
        f"script-src {source_hash(script)}; style-src {source_hash(style)}"
    )
