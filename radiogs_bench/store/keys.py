"""Keys: names of stored files that are hashes of what decides their content."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

KEY_LENGTH = 20
"""Hexadecimal digits of a key: 80 bits, so that a million cells collide with probability 4e-13."""


def canonical(content: Mapping[str, Any]) -> bytes:
    """Canonical bytes of plain content: ASCII JSON with sorted keys and no spaces. Raises ValueError for NaN."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.encode()


def content_key(content: Mapping[str, Any]) -> str:
    """SHA-256 prefix of the canonical JSON of plain ``content``."""
    return hashlib.sha256(canonical(content)).hexdigest()[:KEY_LENGTH]
