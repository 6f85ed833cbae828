"""Unpacks archives of strangers: only files and folders come out, all within one folder, and sizes are bounded."""

import lzma
import posixpath
import shutil
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Generator
from contextlib import closing
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import IO

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
"""Errors that the libraries raise for damaged archives. Errors of writing are explained before they come here."""

MOST_HEADER = 1 << 20
MOST_HEADERS = 1 << 26
"""Bytes of one extended header of a tar (a long name, or pax records), and of all: the library reads them whole."""


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


Member = tuple[PurePosixPath, int, IO[bytes] | None]
"""A member of an archive: path, declared size in bytes (both libraries enforce it), and content; a folder has none."""


def unpack(archive: Path, folder: Path, most_bytes: int | None = None) -> int:
    """Unpack a zip or tar archive into ``folder``, without the folders that all its files lie in; returns their number.

    Files appear in ``folder`` once the whole archive is unpacked. Raises DataError, and leaves ``folder`` as it was,
    for a damaged archive, for members with absolute names, with ``..``, that are links or devices, and for more than
    ``most_bytes`` (None: see ``MOST_TIMES``) or than the disk has room for; StoreError if files cannot be written.
    """
    bound = max(LEAST_BOUND, MOST_TIMES * archive.stat().st_size) if most_bytes is None else most_bytes
    with explained(folder):
        folder.mkdir(parents=True, exist_ok=True)
    bound = min(bound, shutil.disk_usage(folder).free)
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
        with closing(_members(archive)) as members:
            for count, (path, size, content) in enumerate(members, 1):
                if count > MOST_MEMBERS:
                    raise _refused(archive, f"it has more than {MOST_MEMBERS} members")
                if content is None or set(path.parts) & set(CLUTTER):
                    continue
                written += size
                if written > bound:
                    raise _refused(archive, f"unpacked it needs more than {bound} bytes")
                _write(content, waiting / path)
                files.append(path)
    except DAMAGED as error:
        raise DataError(
            f"{archive} is damaged, or no archive: {error}", "Nothing was unpacked.", "Fetch it again."
        ) from error
    return files


def _write(content: IO[bytes], path: Path) -> None:
    """Write a member. Errors of reading are blamed on the archive, errors of writing on the folder."""
    with explained(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("wb")
    with file, content:
        while chunk := content.read(CHUNK):
            with explained(path):
                file.write(chunk)


def _move(waiting: Path, files: list[PurePosixPath], folder: Path) -> int:
    """Put unpacked files in their place, without the folders that all share; files of the same name are replaced."""
    shared = posixpath.commonpath([path.parent for path in files])
    for path in files:
        place = folder / path.relative_to(shared)
        with explained(place):
            place.parent.mkdir(parents=True, exist_ok=True)
            (waiting / path).replace(place)
    return len(set(files))


def _members(archive: Path) -> Generator[Member, None, None]:
    """Every member of a zip or tar archive. Raises DataError for a link, a device, or a name that leads out."""
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as zipped:
            for info in zipped.infolist():
                if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
                    raise _refused(archive, f"'{info.filename}' is a link or a device")
                path = _within(archive, info.orig_filename)
                yield path, info.file_size, None if info.is_dir() else zipped.open(info)
        return
    with tarfile.open(archive, "r:*", tarinfo=_Bounded) as tar:
        for entry in tar:
            if not (entry.isreg() or entry.isdir()):
                raise _refused(archive, f"'{entry.name}' is a link or a device")
            yield _within(archive, entry.name), entry.size, tar.extractfile(entry)


def _within(archive: Path, name: str) -> PurePosixPath:
    """The path of a member; refused if it could lie outside the folder on any system."""
    path = PurePosixPath(name)
    drive = PureWindowsPath(name).drive
    if path.is_absolute() or ".." in path.parts or "\\" in name or "\0" in name or drive:
        raise _refused(archive, f"'{name}' would lie outside its folder")
    return path


def _refused(archive: Path, why: str) -> DataError:
    return DataError(
        f"{archive} is not unpacked: {why}", "Nothing of it was kept.", "If you trust it, unpack it by hand."
    )
