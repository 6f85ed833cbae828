"""Downloads over HTTP, continued where they broke off."""

import hashlib
import http.client
import json
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

from radiogs_core.errors import DataError

from ..store.atomic import explained

TIMEOUT = 60.0
"""Seconds without data after which a connection counts as dead."""

CHUNK = 1 << 20
"""Bytes per read."""

Advance = Callable[[int, int], None]
"""Called with the bytes that are there, and those that will be."""


class DownloadFailed(DataError):
    """A file that could not be downloaded; ``unreachable``: no server answered at all."""

    def __init__(self, what: str, why: str, remedy: str = "", unreachable: bool = False) -> None:
        super().__init__(what, why, remedy)
        self.unreachable = unreachable


def download(url: str, partial: Path, advance: Advance, remedy: str = "", timeout: float = TIMEOUT) -> None:
    """Put the whole of ``url`` into ``partial``, which may hold the beginning of it from an earlier call.

    It is continued only if the server says that the file is still the one that was begun (by its ETag or its date, kept
    in ``<partial>.json``); otherwise it starts again. The received part of an interrupted download is kept. Raises
    DownloadFailed if the server has no such file, cannot be reached or sends less than it promised; StoreError if
    ``partial`` cannot be written.
    """
    begun = _begun(url, partial)
    if begun and partial.stat().st_size == _promised(partial):
        _about(partial).unlink()
        return None
    request = urllib.request.Request(url, headers=_continuing(partial, begun))
    try:
        with urllib.request.urlopen(request, timeout=timeout) as response:
            _receive(url, response, partial, advance)
    except urllib.error.HTTPError as refusal:
        refusal.close()
        if refusal.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE and begun:
            forget(partial)
            return download(url, partial, advance, remedy, timeout)
        answer = f"The server answers {refusal.code} {refusal.reason}."
        raise DownloadFailed(f"cannot fetch {url}", answer, remedy) from refusal
    except (urllib.error.URLError, http.client.HTTPException, OSError) as failure:
        raise DownloadFailed(f"cannot fetch {url}", f"{failure}.", remedy, unreachable=True) from failure
    promised, here = _promised(partial), partial.stat().st_size
    if promised is not None and here < promised:
        raise DownloadFailed(f"{url} ended early", f"{here} of {promised} bytes came.", "Run the same command again.")
    _about(partial).unlink()
    return None


def forget(partial: Path) -> None:
    """Remove what an interrupted download has left."""
    partial.unlink(missing_ok=True)
    _about(partial).unlink(missing_ok=True)


def sha256_of(path: Path) -> str:
    """The file's SHA-256, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _about(partial: Path) -> Path:
    return partial.with_name(f"{partial.name}.json")


def _promised(partial: Path) -> int | None:
    """How many bytes the server said that the whole file has; None if it did not say."""
    promised = json.loads(_about(partial).read_bytes())["bytes"]
    return None if promised is None else int(promised)


def _begun(url: str, partial: Path) -> str:
    """The server's name of the version of the partly downloaded file; empty if the download cannot be continued."""
    try:
        about = json.loads(_about(partial).read_bytes())
    except (OSError, ValueError):
        return ""
    usable = isinstance(about, dict) and about.get("url") == url and partial.is_file()
    return str(about.get("version") or "") if usable else ""


def _continuing(partial: Path, begun: str) -> dict[str, str]:
    size = partial.stat().st_size if begun else 0
    return {"Range": f"bytes={size}-", "If-Range": begun} if size else {}


def _receive(url: str, response: http.client.HTTPResponse, partial: Path, advance: Advance) -> None:
    coming = response.headers.get("Content-Length")
    done = partial.stat().st_size if response.status == http.client.PARTIAL_CONTENT else 0
    where = response.headers.get("Content-Range", "")
    if done and not where.startswith(f"bytes {done}-"):
        raise http.client.HTTPException(f"asked for the bytes from {done} on, it sends '{where}'")
    promised = None if coming is None else done + int(coming)
    etag = response.headers.get("ETag", "")
    version = response.headers.get("Last-Modified", "") if etag.startswith("W/") or not etag else etag
    with explained(partial):
        _about(partial).write_text(json.dumps({"url": url, "version": version, "bytes": promised}))
        file = partial.open("ab" if done else "wb")
    with file:
        while chunk := response.read(CHUNK):
            with explained(partial):
                file.write(chunk)
            done += len(chunk)
            advance(done, max(promised or 0, done))
