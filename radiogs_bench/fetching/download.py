"""Downloads over HTTP, continued where they broke off."""

import hashlib
import http.client
import json
import os
import re
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import BinaryIO

from radiogs_core.errors import DataError

from ..store.atomic import explained, write_atomically
from ..store.opening import opened

TIMEOUT = 60.0
"""Seconds after which a connection counts as dead if fewer than ``LEAST_RATE`` bytes a second came within them."""

LEAST_RATE = 100.0

CHUNK = 1 << 20
"""Bytes per read."""

LONGEST_NOTE = 10_000
"""Bytes of the note beside an unfinished download, at most."""

RANGE = re.compile(r"bytes ([0-9]{1,15})-([0-9]{1,15})/([0-9]{1,15}|\*)", re.ASCII)

LENGTH = re.compile(r"[0-9]{1,15}", re.ASCII)

Advance = Callable[[int, int], None]
"""Called with the bytes that are there, and those that will be."""


class DownloadFailed(DataError):
    """A file that could not be downloaded; ``unreachable``: no server answered at all."""

    def __init__(self, what: str, why: str, remedy: str = "", unreachable: bool = False) -> None:
        super().__init__(what, why, remedy)
        self.unreachable = unreachable


class MalformedAnswer(DataError):
    """An answer that is none by the rules of HTTP, or not the one that was asked for; nothing of it is kept."""


@dataclass(frozen=True)
class Begun:
    """The beginning of a file that an earlier call has left, as the server described it."""

    url: str
    version: str
    """Its ETag, or its date."""
    bytes: int | None
    """Size of the whole file; None where the server did not say."""


def download(url: str, partial: Path, advance: Advance, remedy: str = "", timeout: float = TIMEOUT) -> None:
    """Put the whole of ``url`` into ``partial``, which may hold the beginning of it from an earlier call.

    It is continued only if the server's answer says that the file is still the one that was begun (by its ETag or its
    date, kept in ``<partial>.json``); otherwise it starts again. The received part of an interrupted download is kept.
    Neither file is written through a link. Raises DownloadFailed if the server has no such file, cannot be reached, is
    slower than LEAST_RATE or sends less than it promised; MalformedAnswer; StoreError if ``partial`` cannot be written.
    """
    begun = _begun(url, partial)
    if begun is not None and partial.stat().st_size == begun.bytes:
        return _about(partial).unlink()
    try:
        kept = _receive(url, partial, begun, advance, timeout)
    except urllib.error.HTTPError as refusal:
        refusal.close()
        if refusal.code == http.client.REQUESTED_RANGE_NOT_SATISFIABLE and begun is not None:
            kept = False
        else:
            answer = f"The server answers {refusal.code} {refusal.reason}."
            raise DownloadFailed(f"cannot fetch {url}", answer, remedy) from refusal
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
        raise _malformed(url, f"{type(failure).__name__}: {failure!s:.200}") from failure
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


def _about(partial: Path) -> Path:
    return partial.with_name(f"{partial.name}.json")


def _begun(url: str, partial: Path) -> Begun | None:
    """The file that an earlier call has left, as it noted it down; None if the download cannot be continued."""
    if partial.is_symlink() or not partial.is_file() or _about(partial).is_symlink():
        return None
    try:
        with opened(_about(partial), LONGEST_NOTE) as file:
            about = Begun(**json.loads(file.read()))
    except (DataError, OSError, ValueError, TypeError, RecursionError):
        return None
    size = about.bytes
    sound = about.url == url and isinstance(about.version, str) and about.version.isascii()
    sound = sound and about.version.isprintable() and (size is None or (type(size) is int and size >= 0))
    return about if sound and about.version else (about if sound and size == partial.stat().st_size else None)


def _continuing(partial: Path, begun: Begun | None) -> dict[str, str]:
    size = partial.stat().st_size if begun is not None else 0
    return {"Range": f"bytes={size}-", "If-Range": begun.version} if begun is not None and size else {}


def _receive(url: str, partial: Path, begun: Begun | None, advance: Advance, timeout: float) -> bool:
    """Append or write what the server sends; False if it does not say that it continues what was begun."""
    asked = _continuing(partial, begun)
    arriving = _Arriving(urllib.request.Request(url, headers=asked), timeout)
    with closing(arriving):
        response = arriving.response()
        done = partial.stat().st_size if asked else 0
        if response.status == http.client.PARTIAL_CONTENT and asked:
            assert begun is not None
            if begun.version not in _versions(response) or not _continues(response, done, begun.bytes):
                return False
        elif response.status == http.client.OK:
            done = 0
        else:
            raise http.client.HTTPException(f"its answer to a plain request is {response.status}")
        coming = _length(response)
        whole = None if coming is None else done + coming
        about = Begun(url, _version(response), whole)
        write_atomically(_about(partial), json.dumps(asdict(about)).encode())
        with explained(partial):
            file = _own_file(partial, append=done > 0)
        with file:
            for chunk in arriving.chunks():
                with explained(partial):
                    file.write(chunk)
                done += len(chunk)
                advance(done, max(whole or 0, done))
    return True


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follows redirects; the connection that gave an address that is none is closed, which urllib leaves open."""

    def http_error_302(self, req, fp, code, msg, headers):  # type: ignore[no-untyped-def]
        """The answer of the new address. Raises ValueError for what is no address."""
        try:
            return super().http_error_302(req, fp, code, msg, headers)
        except ValueError:
            fp.close()
            raise

    http_error_301 = http_error_303 = http_error_307 = http_error_308 = http_error_302


class _Arriving:
    """An answer that a thread of its own receives, so that a server that sends byte after byte cannot hold us up."""

    def __init__(self, request: urllib.request.Request, timeout: float) -> None:
        self.request, self.timeout = request, timeout
        self.queue: Queue[http.client.HTTPResponse | bytes | BaseException] = Queue(maxsize=4)
        self.given_up = threading.Event()
        threading.Thread(target=self._work, daemon=True).start()

    def _work(self) -> None:
        try:
            with urllib.request.build_opener(_Redirects).open(self.request, timeout=self.timeout) as response:
                self._put(response)
                while not self.given_up.is_set() and (chunk := response.read1(CHUNK)):
                    self._put(chunk)
                if response.length:  # read1 does not say that something is missing
                    raise http.client.IncompleteRead(b"", response.length)
            self._put(b"")
        except BaseException as error:  # noqa: BLE001  raised where the answer is used
            self._put(error)

    def _put(self, what: http.client.HTTPResponse | bytes | BaseException) -> None:
        while not self.given_up.is_set():
            try:
                return self.queue.put(what, timeout=0.5)
            except Exception:  # noqa: BLE001  the queue is full: whoever empties it may have given up
                continue

    def _next(self, seconds: float) -> http.client.HTTPResponse | bytes:
        try:
            found = self.queue.get(timeout=max(0.0, seconds))
        except Empty:
            raise TimeoutError(f"fewer than {LEAST_RATE:g} bytes a second came in {self.timeout:g} s") from None
        if isinstance(found, BaseException):
            raise found
        return found

    def response(self) -> http.client.HTTPResponse:
        """The head of the answer. Raises what urllib raises, and TimeoutError."""
        found = self._next(self.timeout)
        assert isinstance(found, http.client.HTTPResponse)
        return found

    def chunks(self) -> Iterator[bytes]:
        """The bytes of the answer as they come. Raises what http.client raises, and TimeoutError."""
        began, came = time.monotonic(), 0
        while chunk := self._next(began + self.timeout - time.monotonic()):
            assert isinstance(chunk, bytes)
            yield chunk
            came += len(chunk)
            if came >= LEAST_RATE * self.timeout:
                began, came = time.monotonic(), 0

    def close(self) -> None:
        """Let the thread end as soon as it can."""
        self.given_up.set()


def _own_file(partial: Path, append: bool) -> BinaryIO:
    """The unfinished file, open for writing; a link in its place is not followed."""
    if not append:
        partial.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_NOFOLLOW | os.O_CLOEXEC | (os.O_APPEND if append else os.O_CREAT | os.O_EXCL)
    return open(os.open(partial, flags, 0o666), "ab" if append else "wb")


def _length(response: http.client.HTTPResponse) -> int | None:
    """Bytes that will come; None for an answer in chunks, whose end is marked. Raises HTTPException."""
    coding = response.headers.get("Content-Encoding", "identity")
    if coding.strip().lower() not in ("", "identity"):
        raise http.client.HTTPException(f"it is sent as '{coding:.40}', which was not asked for")
    given = response.headers.get_all("Content-Length") or []
    if response.chunked:
        return None
    if len(set(given)) != 1 or LENGTH.fullmatch(given[0]) is None:
        raise http.client.HTTPException(f"its length is given as {', '.join(given)!r:.60}")
    return int(given[0])


def _continues(response: http.client.HTTPResponse, done: int, whole: int | None) -> bool:
    """Whether a part begins where ours ends, and is of a file of the same length."""
    match = RANGE.fullmatch(response.headers.get("Content-Range", ""))
    return match is not None and int(match[1]) == done and (whole is None or match[3] in ("*", str(whole)))


def _versions(response: http.client.HTTPResponse) -> list[str]:
    return [value for name in ("ETag", "Last-Modified") if (value := response.headers.get(name, ""))]


def _version(response: http.client.HTTPResponse) -> str:
    """The name of this version of the file: its ETag, unless that is weak, else its date; empty without either."""
    etag = response.headers.get("ETag", "")
    return response.headers.get("Last-Modified", "") if etag.startswith("W/") or not etag else etag


def _malformed(url: str, why: str) -> MalformedAnswer:
    return MalformedAnswer(
        f"the answer of {url} is malformed", f"{why}. Nothing of it was kept.", "Try again later, or fetch it by hand."
    )
