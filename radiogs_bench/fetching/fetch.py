"""Fetches a data set: downloads, checks and unpacks missing pieces, and records each piece."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from radiogs_core.errors import DataError

from ..errors import NotFetched
from ..store.atomic import explained, write_atomically
from ..store.opening import LARGEST_TEXT, opened
from ..store.seal import strict_json
from .catalogue import DataSet, Piece
from .download import DownloadFailed, download, forget, require_published
from .unpack import unpack

RECORD = "fetched.json"
"""In a data set's folder: address, size and SHA-256 of every piece that was fetched."""

Advance = Callable[[str, int, int], None]
"""Called with the name of a piece, its bytes done, and its total bytes."""


def fetch_data_set(of: DataSet, root: Path, advance: Advance, say: Callable[[str], None]) -> None:
    """Make ``root/<name>`` hold the data set; existing files stay as they are.

    A piece that lies in that folder under its own name, because somebody put it there, is taken instead of a download,
    and kept. Raises NotFetched if pieces are missing at the end, with what to fetch by hand and where to put it;
    DataError for a file that is not the published one, or that is no sound archive.
    """
    folder = root / of.name
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    missing: list[tuple[Piece, str]] = []
    unreachable = ""
    for piece in of.pieces:
        if piece.name in _record(folder):
            say(f"{piece.name}: is there")
            continue
        placed = (folder / piece.name).is_file()
        if not placed and (piece.by_hand or unreachable):
            missing.append((piece, "only a browser gets it" if piece.by_hand else unreachable))
            continue
        try:
            if not placed:
                _download(piece, folder, advance)
        except DownloadFailed as failure:
            missing.append((piece, failure.why))
            unreachable = failure.why if failure.unreachable else ""
            continue
        say(f"{piece.name}: {_install(piece, folder, placed)}")
    if missing:
        raise not_fetched(of, folder, missing)


def not_fetched(of: DataSet, folder: Path, missing: list[tuple[Piece, str]]) -> NotFetched:
    """The error for pieces that have to be fetched by hand, with their addresses and places."""
    lines = [
        line
        for piece, why in missing
        for line in (f"  {piece.url}", f"    put it at  {folder / piece.name}   ({why.rstrip('.')})")
    ]
    return NotFetched(
        f"{len(missing)} of {len(of.pieces)} files of {of.title} are missing",
        "\n".join(["Fetch them by hand, as they are, without unpacking:", *lines]),
        f"Then run the same command again: it unpacks them.  About the data: {of.page}",
    )


def _download(piece: Piece, folder: Path, advance: Advance) -> None:
    partial = folder / f".{piece.name}.part"
    download(piece.url, partial, lambda done, total: advance(piece.name, done, total))
    size = partial.stat().st_size
    if piece.bytes is not None and size != piece.bytes:
        forget(partial)
        raise DataError(f"{piece.url} has {size} bytes", f"Published are {piece.bytes}. Nothing was kept.", _BY_HAND)
    with explained(partial):
        partial.replace(folder / piece.name)


_BY_HAND = "If the authors have published a new version, put it in its place by hand."


def _install(piece: Piece, folder: Path, placed: bool) -> str:
    """Check a piece, unpack it, and record it; returns what was done, in words."""
    path = folder / piece.name
    size = path.stat().st_size
    try:
        digest = require_published(path, piece.sha256, str(path), "", f"Fetch it again from {piece.url}")
    except DataError:
        if not placed:
            path.unlink()
        raise
    files = unpack(path, folder / piece.into) if piece.packed else 1
    record = {"url": piece.url, "bytes": size, "sha256": digest, "files": files}
    write_atomically(folder / RECORD, strict_json(_record(folder) | {piece.name: record}))
    if piece.packed and not placed:
        path.unlink()
    known = "the published checksum" if piece.sha256 else f"no checksum is published; SHA-256 {digest}, recorded"
    return f"{files} files; {known}"


def _record(folder: Path) -> dict[str, Any]:
    try:
        with opened(folder / RECORD, LARGEST_TEXT) as file:
            return dict[str, Any](**json.loads(file.read()))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise DataError(f"{folder / RECORD} is damaged: {error}", "", "Remove it to fetch everything anew.") from error
