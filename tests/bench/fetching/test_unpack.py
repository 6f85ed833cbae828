"""Archives of strangers: what is sound comes out whole, and what is not leaves nothing behind."""

import gzip
import io
import stat
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from radiogs_bench.fetching import unpack as unpacking
from radiogs_bench.fetching.unpack import unpack
from radiogs_core.errors import DataError

Members = dict[str, bytes]
SOUND: Members = {
    "set/lego/transforms_train.json": b"{}",
    "set/lego/train_000/rgba.png": b"png" * 999,
    "set/read.me": b"x",
}


def zipped(path: Path, members: Members) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("set/", b"")
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def tarred(path: Path, members: Members) -> Path:
    with tarfile.open(path, "w:gz") as archive:
        folder = tarfile.TarInfo("./set")
        folder.type = tarfile.DIRTYPE
        archive.addfile(folder)
        for name, content in members.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


MAKERS = pytest.mark.parametrize("make", [zipped, tarred])
Make = Callable[[Path, Members], Path]


def everything(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@MAKERS
def test_a_sound_archive_is_unpacked_without_its_common_folder(make: Make, tmp_path: Path) -> None:
    assert unpack(make(tmp_path / "a", SOUND | {"__MACOSX/set/._x": b"clutter"}), tmp_path / "out") == 3
    assert everything(tmp_path / "out") == {name.removeprefix("set/"): content for name, content in SOUND.items()}


@pytest.mark.parametrize("kind", [tarfile.XHDTYPE, tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_LONGLINK])
@pytest.mark.parametrize("size", [3 << 30, 2 << 20])
def test_a_header_that_claims_more_than_a_name_has_is_refused_unread(kind: bytes, size: int, tmp_path: Path) -> None:
    """Attack fetch_through_links, tar_bombs: 4 GiB of memory for a file of 3 MB."""
    header = tarfile.TarInfo("././@LongLink")
    header.type, header.size = kind, size
    with gzip.open(tmp_path / "a", "wb") as archive:
        archive.write(header.tobuf(tarfile.GNU_FORMAT) + bytes(min(size, 1 << 16)))
    with pytest.raises(DataError, match="a name or a record of it would take"):
        unpack(tmp_path / "a", tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_headers_are_bounded_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacking, "MOST_HEADERS", 10_000)
    long = {f"{'a' * 150}{number}": b"x" for number in range(100)}
    with pytest.raises(DataError, match="a name or a record of it would take"):
        unpack(tarred(tmp_path / "a", long), tmp_path / "out")
    assert unpack(tarred(tmp_path / "b", dict(list(long.items())[:5])), tmp_path / "out") == 5


@MAKERS
def test_files_that_share_no_folder_stay_where_they_are_and_replace_older_ones(make: Make, tmp_path: Path) -> None:
    (tmp_path / "out" / "room").mkdir(parents=True)
    (tmp_path / "out" / "room" / "a").write_bytes(b"old")
    (tmp_path / "out" / "mine").write_bytes(b"mine")
    unpack(make(tmp_path / "a", {"room/a": b"new", "bonsai/b": b"2"}), tmp_path / "out")
    assert everything(tmp_path / "out") == {"room/a": b"new", "bonsai/b": b"2", "mine": b"mine"}


def refused(archive: Path, tmp_path: Path, complaint: str, most: int | None = None) -> None:
    out = tmp_path / "deep" / "out"
    out.mkdir(parents=True)
    (out / "kept").write_bytes(b"kept")
    before = sorted(path for path in tmp_path.rglob("*"))
    with pytest.raises(DataError, match=complaint):
        unpack(archive, out, most)
    assert sorted(path for path in tmp_path.rglob("*")) == before, "nothing inside or outside has changed"
    assert (out / "kept").read_bytes() == b"kept"


@MAKERS
@pytest.mark.parametrize(
    "name", ["../escaped", "a/../../escaped", "/tmp/escaped", "..\\escaped", "C:\\escaped", "C:escaped", "a/.."]
)
def test_a_name_that_leads_out_is_refused(make: Make, name: str, tmp_path: Path) -> None:
    refused(make(tmp_path / "a", {"good": b"good", name: b"bad"}), tmp_path, "outside its folder")


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.BLKTYPE, tarfile.FIFOTYPE])
def test_links_and_devices_in_a_tar_are_refused(kind: bytes, tmp_path: Path) -> None:
    archive = tarred(tmp_path / "first", SOUND)
    with tarfile.open(tmp_path / "a", "w") as tar:
        info = tarfile.TarInfo("set/way_out")
        info.type, info.linkname = kind, str(tmp_path / "first")
        tar.addfile(info)
        through = tarfile.TarInfo("set/way_out/written")
        tar.addfile(through)
    refused(tmp_path / "a", tmp_path, "is a link or a device")
    assert archive.exists()


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFCHR, stat.S_IFIFO])
def test_links_and_devices_in_a_zip_are_refused(kind: int, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a", "w") as archive:
        info = zipfile.ZipInfo("way_out")
        info.external_attr = (kind | 0o777) << 16
        archive.writestr(info, "/etc")
    refused(tmp_path / "a", tmp_path, "is a link or a device")


@MAKERS
def test_an_archive_that_unpacks_beyond_its_bound_is_refused(make: Make, tmp_path: Path) -> None:
    archive = make(tmp_path / "a", {"zeros": bytes(1 << 20), "more": bytes(1 << 20)})
    assert archive.stat().st_size < 20_000
    refused(archive, tmp_path, "needs more than 2000000 bytes", 2_000_000)


def test_a_member_that_is_larger_than_it_declares_is_refused(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a", {"member": bytes(5000)})
    content = bytearray(archive.read_bytes())
    place = content.rfind(b"PK\x01\x02")
    content[place + 24 : place + 28] = (100).to_bytes(4, "little")  # the declared size, in the central directory
    archive.write_bytes(content)
    refused(archive, tmp_path, "damaged|larger than")


def test_more_members_than_any_data_set_has_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacking, "MOST_MEMBERS", 2)
    refused(zipped(tmp_path / "a", SOUND), tmp_path, "more than 2 members")


@MAKERS
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_half_an_archive_is_damaged(make: Make, share: float, tmp_path: Path) -> None:
    archive = make(tmp_path / "a", {f"set/{place}": bytes(range(256)) * place for place in range(40)})
    archive.write_bytes(archive.read_bytes()[: int(share * archive.stat().st_size)])
    refused(archive, tmp_path, "damaged")


@pytest.mark.parametrize(
    "content",
    [b"", b"<html>Please log in</html>", bytes(3000), b"BZh9" + b"x" * 1000, b"\xfd7zXZ\x00" + b"x" * 1000,
     b"PK\x05\x06" + b"\xff" * 18],
)  # fmt: skip
def test_a_file_that_is_no_archive_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(content)
    refused(tmp_path / "a", tmp_path, "damaged|no files")


def test_a_changed_byte_is_noticed(tmp_path: Path) -> None:
    archive = zipped(tmp_path / "a", {"set/a": bytes(range(256)) * 40})
    content = bytearray(archive.read_bytes())
    content[content.find(b"set/a") + 40] ^= 0xFF
    archive.write_bytes(content)
    refused(archive, tmp_path, "damaged")


def test_rights_of_the_archive_are_not_taken_over(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "a", "w") as archive:
        info = tarfile.TarInfo("program")
        info.mode = 0o6777
        archive.addfile(info)
    unpack(tmp_path / "a", tmp_path / "out")
    assert not (tmp_path / "out" / "program").stat().st_mode & 0o6111
