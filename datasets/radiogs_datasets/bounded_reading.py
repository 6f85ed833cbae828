"""Reading untrusted files: regular files only, with limits on size, depth and length.

A named pipe would block for ever, a device never ends, and a header of a few bytes can claim terabytes. So a file's
kind and size are checked before its bytes are read, and sizes in headers before memory is allocated. Limits can be
raised by environment variables (``LIMITS``); every refusal names its limit.
"""

import io
import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from radiogs_core.errors import DataError, UsageError

from .same_bytes import require_same

FILE_LIMIT = "RADIOGS_BENCH_LARGEST_FILE"
IMAGE_LIMIT = "RADIOGS_BENCH_LARGEST_IMAGE"
TABLE_LIMIT = "RADIOGS_BENCH_LARGEST_TABLE"
TOML_LIMIT = "RADIOGS_BENCH_LARGEST_TOML"

LIMITS = {FILE_LIMIT: 1 << 32, IMAGE_LIMIT: 1 << 26, TABLE_LIMIT: 1 << 28, TOML_LIMIT: 1 << 20}
"""Defaults by environment variable: bytes of a file (4 GiB), pixels of an image (8192 x 8192, which take about 3 GiB
while they are read), bytes of a JSON file (256 MiB: a million frames), and bytes of a TOML file (1 MiB)."""

DEEPEST_KEY = 32
"""Parts of a dotted key in TOML; a suite's have four."""

LONG_KEY = re.compile(
    rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{DEEPEST_KEY}}}(?=[\w"'-])"""
)

DEEPEST_JSON = 64
"""Most levels of nested objects and lists; transforms files have four."""

JSON_TEXT = re.compile(r'"(?:[^"\\]|\\.)*"')
"""A text in JSON, with its quotation marks."""

LONGEST_NUMBER = 4000
"""Digits of a real number in JSON; Python itself bounds whole numbers."""

LONGEST_NAME = 200
"""Bytes of a view's or scene's name as part of a file name: file systems end at 255, and endings are added."""


def limit(variable: str) -> int:
    """The limit of that name: the environment's, else the default. Raises UsageError unless it is a whole number."""
    text = os.environ.get(variable)
    if text is None:
        return LIMITS[variable]
    if not text.isdecimal() or len(text) > 18 or int(text) == 0:
        raise UsageError(f"{variable} is '{text:.40}'", "It is a limit.", "Give a whole number above zero.")
    return int(text)


def read_bytes(path: Path, bound: str = FILE_LIMIT) -> bytes:
    """The content of a regular file. Raises DataError if it is not regular, too large, or cannot be read.

    Also raises DataError if the file of a scene being read has changed since (``same_bytes``).
    """
    try:
        # Without O_NONBLOCK, opening a named pipe would wait for somebody to write into it.
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            found = os.fstat(handle)
            _require_regular(path, found, bound)
            with open(handle, "rb", closefd=False) as file:
                data = file.read(found.st_size + 1)
        finally:
            os.close(handle)
    except OSError as error:
        raise DataError(
            f"cannot read {printable(path)}",
            f"The system says: {error.strerror}.",
            "Check the path, and that you may read the file.",
        ) from error
    except ValueError as error:  # a name with a NUL, or one that the file system's encoding does not have
        raise DataError(
            f"cannot read {printable(path)}", "No file can have this name.", "Correct the name where it is written."
        ) from error
    if len(data) > found.st_size:
        raise DataError(f"{printable(path)} grows while it is read", "", "Read it when it is complete.")
    require_same(path, data)
    return data


def _require_regular(path: Path, found: os.stat_result, bound: str) -> None:
    if not stat.S_ISREG(found.st_mode):
        kinds = {stat.S_IFIFO: "a named pipe", stat.S_IFCHR: "a device", stat.S_IFDIR: "a folder"}
        kind = kinds.get(stat.S_IFMT(found.st_mode), "no regular file")
        raise DataError(f"{printable(path)} is {kind}", "Only regular files are read.", "Put a file in its place.")
    largest = limit(bound)
    if found.st_size > largest:
        raise DataError(
            f"{printable(path)} has {found.st_size} bytes",
            f"A file of its kind is read up to {largest} bytes.",
            f"If it is what you mean, raise the limit:  {bound}={found.st_size}",
        )


def printable(path: Path | str) -> str:
    """A path as printable text: bytes that are not UTF-8 are escaped, and a very long path is cut in its middle."""
    text = os.fspath(path).encode("utf-8", "backslashreplace").decode()
    text = "".join(letter if letter.isprintable() else f"\\x{ord(letter):02x}" for letter in text)
    return text if len(text) <= 2 * LONGEST_NAME else f"{text[:LONGEST_NAME]}...{text[-LONGEST_NAME:]}"


def require_storable(name: str, what: str) -> None:
    """Raise DataError for a name that cannot be part of the file names of figures and renders."""
    encoded = name.encode("utf-8", "backslashreplace")
    if len(encoded) > LONGEST_NAME or encoded.decode() != name or not name.isprintable():
        raise DataError(
            f"{what} is called '{printable(name)}'",
            f"Renders and figures are stored under it: it must be at most {LONGEST_NAME} bytes of printable UTF-8.",
            "Rename it.",
        )


def read_json(path: Path) -> Any:
    """The value of a JSON file. Raises DataError for a file that is too large, too deep, or not JSON.

    Text that no encoding can store (a half of a surrogate pair) is refused. NaN, infinity and numbers beyond float64
    are returned: the reader of a field refuses them by its name.
    """
    try:
        text = read_bytes(path, TABLE_LIMIT).decode("utf-8-sig")
        if text.count("[") + text.count("{") > DEEPEST_JSON:
            bare = np.frombuffer(JSON_TEXT.sub("", text).encode(), np.uint8)
            opens, closes = np.isin(bare, (ord("["), ord("{"))), np.isin(bare, (ord("]"), ord("}")))
            if int(np.cumsum(opens.astype(np.int64) - closes).max(initial=0)) > DEEPEST_JSON:
                raise ValueError(f"it is nested deeper than {DEEPEST_JSON}")
        value = json.loads(text, parse_float=_real)
        if "\\ud" in text or "\\uD" in text:
            json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise DataError(
            f"{printable(path)} is not valid JSON: {error!s:.200}", "Nothing in it can be read.", "Copy or correct it."
        ) from error
    return value


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file that people write. Raises DataError where it cannot be read or is too large.

    Raises ValueError for text that is not TOML, and for a key of more than DEEPEST_KEY parts: the reader's memory grows
    with the square of the number of parts.
    """
    text = read_bytes(path, TOML_LIMIT).decode()
    if LONG_KEY.search(text):
        raise ValueError(f"a key has more than {DEEPEST_KEY} parts")
    return tomllib.loads(text)


def _real(digits: str) -> float:
    if len(digits) > LONGEST_NUMBER:
        raise ValueError(f"a number of {len(digits)} digits")
    return float(digits)


def read_numpy(path: Path) -> NDArray:
    """The array of a ``.npy`` file, which holds no Python objects. Raises DataError."""
    try:
        return np.lib.format.read_array(io.BytesIO(read_bytes(path)), allow_pickle=False)
    except (OSError, EOFError, ValueError, MemoryError, SyntaxError, OverflowError) as error:
        raise DataError(
            f"cannot read {printable(path)}", f"NumPy says: {error!s:.300}.", "Write it anew with numpy.save."
        ) from error


def as_float32(path: Path, values: NDArray) -> NDArray[np.float32]:
    """Real numbers in float32. Raises DataError where one is not finite, or no longer is in float32 (above 3.4e38)."""
    with np.errstate(over="ignore"):
        numbers = values.astype(np.float32) if np.isrealobj(values) else np.full(1, np.nan, np.float32)
    return finite(path, numbers, "NaN, infinite or beyond 3.4e38")


Number = TypeVar("Number", bound=np.floating)


def finite(path: Path, values: NDArray[Number], unlike: str = "NaN or infinite") -> NDArray[Number]:
    """The values of a file. Raises DataError, with ``unlike`` in words, where one is not finite."""
    bad = int((~np.isfinite(values)).sum())
    if bad:
        raise DataError(
            f"{printable(path)} holds {bad} values that are {unlike}",
            "Every metric and every gradient they meet would become NaN.",
            "Render the file again, or mend the pixels with a tool of your choice.",
        )
    return values
