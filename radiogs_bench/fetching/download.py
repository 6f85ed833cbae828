"""Downloads over HTTP, continued where they broke off."""

import hashlib
import http.client
import io
import json
import re
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, TypedDict, cast

from radiogs_core.errors import DataError

from ..store.atomic import explained, write_atomically
from ..store.opening import opened
from ..store.shapes import mismatch

TIMEOUT = 60.0
"""Seconds after which a connection counts as dead if fewer than ``LEAST_RATE`` bytes a second came within them."""

LEAST_RATE = 100.0

CHUNK = 1 << 20
"""Bytes per read."""

LONGEST_NOTE = 10_000
"""Bytes of the note beside an unfinished download, at most."""

RANGE = re.compile(r"bytes ([0-9]{1,15})-[0-9]{1,15}/([0-9]{1,15}|\*)", re.ASCII)

Advance = Callable[[int, int], None]
"""Called with the number of bytes received so far, and the total."""


class DownloadFailed(DataError):
    """A file that could not be downloaded; ``unreachable``: no server answered at all."""

    def __init__(self, what: str, why: str, remedy: str = "", unreachable: bool = False) -> None:
        super().__init__(what, why, remedy)
        self.unreachable = unreachable


class MalformedAnswer(DataError):
    """An answer that breaks the rules of HTTP, or answers another request; its bytes are not kept."""


class Begun(TypedDict):
    """The beginning of a file that an earlier call has downloaded, as the server described the file."""

    url: str
    version: str
    """The server's ETag, or its date."""
    bytes: int | None
    """Size of the whole file; None if the server did not state it."""


def download(url: str, partial: Path, advance: Advance, remedy: str = "", timeout: float = TIMEOUT) -> None:
    """Download ``url`` to ``partial``, which may hold the file's beginning from an earlier call.

    It is continued only if the server's answer names the version that was begun (by its ETag or its date, kept in
    ``<partial>.json``); otherwise it starts again. The received part of an interrupted download is kept. Neither file
    is written through a link. Raises DownloadFailed if the server has no such file, cannot be reached, is slower than
    LEAST_RATE or sends less than it promised; MalformedAnswer; StoreError if ``partial`` cannot be written.
    """
    begun = _begun(url, partial)
    if begun is not None and partial.stat().st_size == begun["bytes"]:
        return _about(partial).unlink()
    try:
        kept = _receive(url, partial, begun, advance, timeout)
    except urllib.error.HTTPError as refusal:
        refusal.close()
        if refusal.code != http.client.REQUESTED_RANGE_NOT_SATISFIABLE or begun is None:
            answer = f"The server answers {refusal.code} {refusal.reason}."
            raise DownloadFailed(f"cannot fetch {url}", answer, remedy) from refusal
        kept = False
    except http.client.IncompleteRead as failure:
        here = partial.stat().st_size if partial.is_file() else 0
        whole = "" if failure.expected is None else f" of {here + failure.expected}"
        if not whole:  # an answer in chunks: where it goes on cannot be asked for
            forget(partial)
        raise DownloadFailed(
            f"{url} ended early", f"{here}{whole} bytes came.", "Run the same command again."
        ) from failure
    except (urllib.error.URLError, http.client.RemoteDisconnected, OSError) as failure:
        raise DownloadFailed(f"cannot fetch {url}", f"{failure}.", remedy, unreachable=True) from failure
    except (http.client.HTTPException, ValueError, OverflowError) as failure:
        forget(partial)
        raise MalformedAnswer(
            f"the answer of {url} is malformed",
            f"{type(failure).__name__}: {failure!s:.200}. Nothing of it was kept.",
            "Try again later, or fetch it by hand.",
        ) from failure
    if not kept:
        forget(partial)
        return download(url, partial, advance, remedy, timeout)
    return _about(partial).unlink()


def forget(partial: Path) -> None:
    """Remove what an interrupted download has left."""
    partial.unlink(missing_ok=True)
    _about(partial).unlink(missing_ok=True)


def sha256_of(path: Path) -> str:
    """The file's SHA-256, hexadecimal."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def require_published(path: Path, sha256: str, named: str, kept: str, remedy: str) -> str:
    """The file's SHA-256. Raises DataError for a file, ``named`` in the message, whose digest begins otherwise."""
    digest = sha256_of(path)
    if not digest.startswith(sha256):
        begins = f"Its SHA-256 begins with {digest[:8]}, not with {sha256[:8]}."
        raise DataError(f"{named} is not the published file", f"{begins} {kept}".strip(), remedy)
    return digest


def _about(partial: Path) -> Path:
    return partial.with_name(f"{partial.name}.json")


def _begun(url: str, partial: Path) -> Begun | None:
    """The beginning that an earlier call has noted down; None if the download cannot be continued."""
    if partial.is_symlink() or not partial.is_file() or _about(partial).is_symlink():
        return None
    try:
        with opened(_about(partial), LONGEST_NOTE) as file:
            about = json.loads(file.read())
    except (DataError, OSError, ValueError, RecursionError):
        return None
    if mismatch(about, Begun) or about["url"] != url:
        return None
    version = about["version"]
    return cast(Begun, about) if version and version.isascii() and version.isprintable() else None


def _receive(url: str, partial: Path, begun: Begun | None, advance: Advance, timeout: float) -> bool:
    """Append or write what the server sends; False if its answer does not continue what was begun."""
    done = partial.stat().st_size if begun is not None else 0
    asked = {"Range": f"bytes={done}-", "If-Range": begun["version"]} if begun is not None and done else {}
    opener = urllib.request.build_opener(_Http, _Redirects)
    with opener.open(urllib.request.Request(url, headers=asked), timeout=timeout) as response:
        if response.status == http.client.PARTIAL_CONTENT and asked:
            assert begun is not None
            if begun["version"] != _version(response) or not _continues(response, done, begun["bytes"]):
                return False
        elif response.status == http.client.OK:
            done = 0
        else:
            raise http.client.HTTPException(f"its answer to a plain request is {response.status}")
        coming = _length(response)
        whole = None if coming is None else done + coming
        about = Begun(url=url, version=_version(response), bytes=whole)
        write_atomically(_about(partial), json.dumps(about).encode())
        with explained(partial):
            if not done:
                partial.unlink(missing_ok=True)
            file = partial.open("ab" if done else "xb")
        with file:
            while chunk := response.read1(CHUNK):
                with explained(partial):
                    file.write(chunk)
                done += len(chunk)
                advance(done, max(whole or 0, done))
        if response.length:  # read1 does not report that something is missing
            raise http.client.IncompleteRead(b"", response.length)
    return True


def _length(response: http.client.HTTPResponse) -> int | None:
    """Bytes that will follow; None for a chunked answer, which marks its own end. Raises HTTPException."""
    coding = response.headers.get("Content-Encoding", "identity")
    if coding.strip().lower() not in ("", "identity"):
        raise http.client.HTTPException(f"it is sent as '{coding:.40}', which was not asked for")
    given = {*response.headers.get_all("Content-Length", ())}
    if not response.chunked and (response.length is None or len(given) != 1):
        raise http.client.HTTPException(f"its length is given as {', '.join(sorted(given))!r:.60}")
    return response.length


def _continues(response: http.client.HTTPResponse, done: int, whole: int | None) -> bool:
    """Whether an answer continues where our part ends, and belongs to a file of the same length."""
    match = RANGE.fullmatch(response.headers.get("Content-Range", ""))
    return match is not None and int(match[1]) == done and (whole is None or match[2] in ("*", str(whole)))


def _version(response: http.client.HTTPResponse) -> str:
    """The server's name of this version of the file: its ETag, unless that is weak, else its date; may be empty."""
    etag = response.headers.get("ETag", "")
    return response.headers.get("Last-Modified", "") if etag.startswith("W/") or not etag else etag


class _Paced(io.RawIOBase):
    """The bytes of a connection, at a bounded pace: a server that sends single bytes would never reach the timeout."""

    def __init__(self, source: io.BufferedReader, timeout: float) -> None:
        self.source, self.timeout = source, timeout
        self.began, self.came = time.monotonic(), 0

    def readable(self) -> bool:
        """Always true."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read available bytes. Raises TimeoutError if fewer than LEAST_RATE bytes a second came for a while."""
        count = self.source.readinto1(buffer)
        self.came += count
        if self.came >= LEAST_RATE * self.timeout:
            self.began, self.came = time.monotonic(), 0
        elif count and time.monotonic() > self.began + self.timeout:
            raise TimeoutError(f"fewer than {LEAST_RATE:g} bytes a second came in {self.timeout:g} s")
        return count

    def close(self) -> None:
        """Close the connection's own stream."""
        self.source.close()
        super().close()


class _Answer(http.client.HTTPResponse):
    """An answer whose head and body are read at a bounded pace."""

    def __init__(self, sock: Any, *further: Any, **named: Any) -> None:
        super().__init__(sock, *further, **named)
        self.fp = io.BufferedReader(_Paced(self.fp, sock.gettimeout()))


class _Connection(http.client.HTTPConnection):
    response_class = _Answer


class _SecureConnection(http.client.HTTPSConnection):
    response_class = _Answer


class _Http(urllib.request.HTTPHandler, urllib.request.HTTPSHandler):
    """Opens http and https addresses."""

    def http_open(self, req: urllib.request.Request) -> http.client.HTTPResponse:
        """Open an unencrypted connection."""
        return self.do_open(_Connection, req)

    def https_open(self, req: urllib.request.Request) -> http.client.HTTPResponse:
        """Open an encrypted connection."""
        return self.do_open(_SecureConnection, req)


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects, and closes the answer with a malformed address, which urllib leaves open."""

    def http_error_302(self, req, fp, code, msg, headers):  # type: ignore[no-untyped-def]
        """The answer of the new address. Raises ValueError for a malformed address."""
        with closing(fp):
            return super().http_error_302(req, fp, code, msg, headers)

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302
