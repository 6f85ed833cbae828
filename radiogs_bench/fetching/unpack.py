"""Unpacks archives of strangers: only files and folders come out, all within one folder, and sizes are bounded."""

import lzma
import shutil
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Protocol, runtime_checkable

from radiogs_core.errors import DataError

from ..store.atomic import explained

MOST_MEMBERS = 1_000_000
MOST_TIMES = 20
LEAST_BOUND = 1 << 30
"""An archive may hold so many members, and unpack to so many times its own size, or to 1 GiB if that is more: images
hardly compress, and an archive that grows beyond it is made to fill the disk."""

CHUNK = 1 << 20

CLUTTER = ("__MACOSX", ".DS_Store")
"""Files that macOS adds to archives; they are left out."""

DAMAGED = (
    tarfile.TarError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError,
    OSError, ValueError, OverflowError, MemoryError, struct.error, AssertionError,
)  # fmt: skip
"""Errors of the libraries on what is no archive. Errors of writing are explained before they come here."""

MOST_HEADER = 1 << 20
MOST_HEADERS = 1 << 26
"""Bytes of one extended header of a tar (a long name, or pax records), and of all: the library reads them whole."""


@runtime_checkable
class Readable(Protocol):
    """A member of an archive as zipfile and tarfile open it."""

    def read(self, size: int, /) -> bytes:
        """At most so many of the next bytes; none at the end."""

    def close(self) -> None:
        """Give back what reading needs."""


class _Bounded(tarfile.TarInfo):
    """The header of a member; one that claims more bytes than a name can have is refused before they are read."""

    def _proc_member(self, tar: tarfile.TarFile) -> tarfile.TarInfo:
        """Called by tarfile for each header; its documentation has it overridden for such purposes."""
        if self.type in EXTENDED:
            tar.header_bytes = getattr(tar, "header_bytes", 0) + self.size  # type: ignore[attr-defined]
            if self.size > MOST_HEADER or tar.header_bytes > MOST_HEADERS:  # type: ignore[attr-defined]
                raise tarfile.ReadError(f"a name or a record of it would take {self.size} bytes")
        return super()._proc_member(tar)  # type: ignore[misc]


EXTENDED = (
    tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_LONGLINK, tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE,
)  # fmt: skip


@dataclass(frozen=True)
class Member:
    """A file of an archive: its path within, the size that the archive declares, and its content (None: a folder)."""

    path: PurePosixPath
    size: int
    content: Readable | None


def unpack(archive: Path, folder: Path, most_bytes: int | None = None) -> int:
    """Unpack a zip or tar archive into ``folder``, without the folders that all its files lie in; returns their number.

    Files appear in ``folder`` once the whole archive is unpacked. Raises DataError, and leaves ``folder`` as it was,
    for a damaged archive, for members with absolute names, with ``..``, that are links or devices, and for more than
    ``most_bytes`` (None: see ``MOST_TIMES``) or than the disk has room for; StoreError if files cannot be written.
    """
    bound = max(LEAST_BOUND, MOST_TIMES * archive.stat().st_size) if most_bytes is None else most_bytes
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    room = shutil.disk_usage(folder).free
    if room < bound:
        bound = room
    waiting = folder / f".{archive.name}.unpacking"
    shutil.rmtree(waiting, ignore_errors=True)
    try:
        with explained(waiting):
            waiting.mkdir()
        files = _write_all(archive, waiting, bound)
        if not files:
            raise DataError(f"{archive} holds no files")
        return _move(waiting, files, folder)
    finally:
        shutil.rmtree(waiting, ignore_errors=True)


def _write_all(archive: Path, waiting: Path, bound: int) -> list[PurePosixPath]:
    files: list[PurePosixPath] = []
    written = 0
    try:
        with _members(archive) as members:
            for count, member in enumerate(members, 1):
                if count > MOST_MEMBERS:
                    raise _refused(archive, f"it has more than {MOST_MEMBERS} members")
                if member.content is None or set(member.path.parts) & set(CLUTTER):
                    continue
                written += member.size
                if written > bound:
                    raise _refused(archive, f"unpacked it needs more than {bound} bytes")
                _write(archive, member, waiting / member.path)
                files.append(member.path)
    except DAMAGED as error:
        raise DataError(
            f"{archive} is damaged, or no archive: {error}", "Nothing was unpacked.", "Fetch it again."
        ) from error
    return files


def _write(archive: Path, member: Member, path: Path) -> None:
    assert member.content is not None
    left = member.size
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("wb")
    with file, closing(member.content) as content:
        while chunk := content.read(CHUNK):
            left -= len(chunk)
            if left < 0:
                raise _refused(archive, f"'{member.path}' is larger than the {member.size} bytes that it declares")
            with explained(path):
                file.write(chunk)
    if left:
        raise DataError(f"{archive} is damaged: '{member.path}' lacks {left} bytes", "Nothing was unpacked.")


def _move(waiting: Path, files: list[PurePosixPath], folder: Path) -> int:
    """Put unpacked files in their place; what was there by the same name is replaced."""
    common = _common_folder(files)
    for path in files:
        place = folder.joinpath(*path.parts[common:])
        with explained(place):
            place.parent.mkdir(parents=True, exist_ok=True)
            (waiting / path).replace(place)
    return len(set(files))


def _common_folder(files: list[PurePosixPath]) -> int:
    """How many leading folders all files share."""
    shared = files[0].parts[:-1]
    for path in files:
        same = [first == second for first, second in zip(shared, path.parts[:-1], strict=False)]
        shared = shared[: [*same, False].index(False)]
    return len(shared)


@contextmanager
def _members(archive: Path) -> Iterator[Iterator[Member]]:
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as zipped:
            yield _of_zip(archive, zipped)
    else:
        with tarfile.open(archive, "r:*", tarinfo=_Bounded) as tar:
            yield _of_tar(archive, tar)


def _of_zip(archive: Path, zipped: zipfile.ZipFile) -> Iterator[Member]:
    for info in zipped.infolist():
        kind = stat.S_IFMT(info.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise _refused(archive, f"'{info.filename}' is a link or a device")
        path = _within(archive, info.orig_filename)
        yield Member(path, info.file_size, None if info.is_dir() else zipped.open(info))


def _of_tar(archive: Path, tar: tarfile.TarFile) -> Iterator[Member]:
    for info in tar:
        if not (info.isreg() or info.isdir()):
            raise _refused(archive, f"'{info.name}' is a link or a device")
        yield Member(_within(archive, info.name), info.size, tar.extractfile(info))


def _within(archive: Path, name: str) -> PurePosixPath:
    """The path of a member; refused if it could lie outside the folder on any system."""
    path = PurePosixPath(name)
    drive = PureWindowsPath(name).drive
    if path.is_absolute() or ".." in path.parts or "\\" in name or "\0" in name or drive:
        raise _refused(archive, f"'{name}' would lie outside its folder")
    return path


def _refused(archive: Path, why: str) -> DataError:
    return DataError(
        f"{archive} is not unpacked: {why}",
        "Nothing of it was kept.",
        "If you trust it, unpack it by hand.",
    )
