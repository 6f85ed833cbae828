"""Keys: names of stored files that are hashes of what decides their content; and names that become parts of paths."""

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

from radiogs_core.errors import DataError

KEY_LENGTH = 20
"""Hexadecimal digits of a key: 80 bits, so that a million cells collide with probability 4e-13."""


def canonical(content: Mapping[str, Any]) -> bytes:
    """Canonical bytes of plain content: ASCII JSON with sorted keys and no spaces. Raises ValueError for NaN."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.encode()


def content_key(content: Mapping[str, Any]) -> str:
    """SHA-256 prefix of the canonical JSON of plain ``content``."""
    return hashlib.sha256(canonical(content)).hexdigest()[:KEY_LENGTH]


PLAIN = re.compile(r"(?!\.)[\w.-]{1,120}")
"""Pattern of plain names: letters, digits, dots, dashes and underscores, not beginning with a dot."""


def plain_name(name: object, origin: str) -> str:
    """The name, if it is a plain file name. Raises DataError, which names its ``origin``."""
    if isinstance(name, str) and PLAIN.fullmatch(name) is not None:
        return name
    raise DataError(
        f"{origin} is no plain file name: {name!r:.200}",
        "Names from stored files become names of files; this one could lead out of the folder.",
        "Do not use this file unless you know who made it; a run of your own writes plain names.",
    )
