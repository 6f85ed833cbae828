"""Seals: every stored JSON file carries a digest of its own content, so that a changed digit is seen.

The seal is the SHA-256 of the file's content without the key ``seal``, as canonical JSON (``keys.canonical``). It
guards against damage and careless edits. It is no signature: who changes a file on purpose can seal it again.
"""

import hashlib
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from radiogs_core.errors import DataError

from ..errors import StoreError
from .atomic import write_atomically
from .keys import canonical
from .opening import LARGEST_TEXT, explained_reading, opened
from .shapes import mismatch

SEAL = "seal"


class Broken(Exception):
    """A stored file differs from what was written; the text gives the evidence."""


class OtherSchema(StoreError):
    """A file that another version of the code wrote."""


def seal_of(content: Mapping[str, Any]) -> str:
    """The seal that belongs to plain content. Raises ValueError for NaN, which JSON does not know."""
    return hashlib.sha256(canonical({name: value for name, value in content.items() if name != SEAL})).hexdigest()


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with its seal."""
    return {**content, SEAL: seal_of(content)}


def strict_json(content: Mapping[str, Any]) -> bytes:
    """JSON without NaN and infinity, one value per line, with the same bytes for the same content."""
    return (json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()


def write_sealed(path: Path, content: Mapping[str, Any]) -> None:
    """Write plain content with its seal, whole or not at all. Raises StoreError, and ValueError for NaN."""
    write_atomically(path, strict_json(sealed(content)))


def read_sealed(path: Path, schema: str, required: Collection[str], kind: Any = Any) -> dict[str, Any]:
    """The content of a sealed file, whose seal agrees, and which has the types of ``kind`` (``shapes.mismatch``).

    Raises FileNotFoundError; StoreError where the file cannot be read; DataError for a file that is too large or not
    regular; OtherSchema for a file of another version; and Broken for anything else: not a JSON object, a missing or
    wrong seal, a missing key, a value of another type.
    """
    with explained_reading(path), opened(path, LARGEST_TEXT) as file:
        content = file.read()
    stored = parsed(content)
    complaint = complaint_of(stored)
    if stored.get("schema") != schema and (complaint is None or SEAL not in stored):
        raise OtherSchema(
            f"{path} was written under another schema: {stored.get('schema')!r:.80}",
            f"This version reads {schema}.",
            "Use the version that wrote it, or another folder:  --out FOLDER",
        )
    if complaint is not None:
        raise Broken(complaint)
    if missing := sorted(set(required) - stored.keys()):
        raise Broken(f"it lacks {', '.join(missing)}")
    if wrong := mismatch(stored, kind):
        raise Broken(wrong)
    return stored


def read_kept(path: Path, noun: str, schema: str, required: Collection[str], remedy: str) -> dict[str, Any]:
    """``read_sealed`` a file that a user names, such as a record. Raises DataError with the remedy for any other file,
    and for one that was changed after it was made.
    """
    try:
        return read_sealed(path, schema, required)
    except FileNotFoundError:
        raise DataError(f"there is no {noun} {path}", "", remedy) from None
    except OtherSchema as other:
        raise DataError(f"{path} is no {noun} of this version ({schema})", other.what, remedy) from other
    except Broken as broken:
        what = f"cannot use the {noun} {path}: {broken}"
        raise DataError(what, "It was changed after it was made.", remedy) from broken


def parsed(content: bytes) -> dict[str, Any]:
    """A JSON object. Raises Broken."""
    try:
        stored = json.loads(content)
    except (ValueError, RecursionError):
        raise Broken("it is not JSON") from None
    if not isinstance(stored, dict):
        raise Broken("it is not a JSON object")
    return stored


def complaint_of(stored: Mapping[str, Any]) -> str | None:
    """The reason why parsed content differs from the sealed one; None if it does not."""
    if SEAL not in stored:
        return "it carries no seal"
    try:
        agrees = seal_of(stored) == stored[SEAL]
    except (ValueError, RecursionError):
        agrees = False
    return None if agrees else "its content does not agree with its seal"
