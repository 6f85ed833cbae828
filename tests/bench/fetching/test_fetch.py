"""Data sets from a server that may break off, forget, change or be gone; messages then state what to do."""

import io
import re
import socketserver
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from radiogs_bench.cli import main
from radiogs_bench.errors import NotFetched, exit_code
from radiogs_bench.fetching import catalogue
from radiogs_bench.fetching.catalogue import CAPTURES, DATA_SETS, DataSet, Piece
from radiogs_bench.fetching.download import DownloadFailed, MalformedAnswer, download, sha256_of
from radiogs_bench.fetching.fetch import fetch_data_set
from radiogs_bench.suites.registry import SUITES
from radiogs_core.errors import DataError, UsageError

CONTENT = bytes(range(256)) * 4000


class Server(ThreadingHTTPServer):
    """Serves ``files``; sends ``most`` bytes an answer and then breaks off; understands ranges if ``ranges``.

    ``careless``: it continues whatever it is asked for, and its ETag names the version.
    """

    files: dict[str, bytes]
    most = 1 << 40
    ranges, careless = True, False
    version = '"one"'

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answers)
        self.files, self.asked = {}, []
        self.asked: list[tuple[str, str | None]]

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class Answers(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        wanted = self.headers.get("Range")
        self.server.asked.append((self.path, wanted))
        content = self.server.files.get(self.path)
        if content is None:
            self.send_error(404)
            return
        whole, first = len(content), 0
        agrees = self.headers.get("If-Range") == self.server.version
        if wanted and self.server.ranges and (agrees or self.server.careless):
            first = int(re.fullmatch(r"bytes=(\d+)-", wanted)[1])  # type: ignore[index]
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {first}-{whole - 1}/{whole}")
        else:
            self.send_response(200)
        self.send_header("ETag", self.server.version)
        self.send_header("Content-Length", str(whole - first))
        self.end_headers()
        self.wfile.write(content[first : first + self.server.most])

    def log_message(self, format: str, *arguments: object) -> None:
        pass


@pytest.fixture
def server() -> Iterator[Server]:
    serving = Server()
    thread = threading.Thread(target=serving.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield serving
    serving.shutdown()
    thread.join()
    serving.server_close()


def nothing(*progress: object) -> None:
    pass


def test_a_download_that_breaks_off_goes_on_where_it_stopped(server: Server, tmp_path: Path) -> None:
    server.files["/a"], server.most, server.version = CONTENT, 400_000, '"of today"'
    told: list[tuple[int, int]] = []
    for _ in range(2):
        with pytest.raises(DownloadFailed, match="ended early"):
            download(f"{server.url}/a", tmp_path / "a", lambda *each: told.append(each))
    download(f"{server.url}/a", tmp_path / "a", lambda *each: told.append(each))
    assert (tmp_path / "a").read_bytes() == CONTENT
    assert [wanted for _, wanted in server.asked] == [None, "bytes=400000-", "bytes=800000-"]
    assert told[-1] == (len(CONTENT), len(CONTENT))
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize(
    ("changes", "asked"),
    [
        ({"version": '"two"'}, [None, "bytes=400000-"]),
        ({"ranges": False}, [None, "bytes=400000-"]),
        ({"version": '"two"', "careless": True}, [None, "bytes=400000-", None]),
        ({"version": "", "careless": True}, [None, "bytes=400000-", None]),
    ],
)
def test_a_download_starts_again_if_the_file_changed_or_the_server_has_no_ranges(
    changes: dict[str, Any], asked: list[str | None], server: Server, tmp_path: Path
) -> None:
    """Also where the server does not look (attack fetch_through_links, resumed_mixture)."""
    server.files["/a"], server.most = CONTENT, 400_000
    with pytest.raises(DownloadFailed):
        download(f"{server.url}/a", tmp_path / "a", nothing)
    server.most, server.files["/a"] = 1 << 40, CONTENT[::-1]
    for name, value in changes.items():
        setattr(server, name, value)
    download(f"{server.url}/a", tmp_path / "a", nothing)
    assert (tmp_path / "a").read_bytes() == CONTENT[::-1]
    assert [wanted for _, wanted in server.asked] == asked


def test_nothing_is_continued_that_another_address_began(server: Server, tmp_path: Path) -> None:
    server.files |= {"/a": CONTENT, "/b": CONTENT[::-1]}
    server.most = 400_000
    with pytest.raises(DownloadFailed):
        download(f"{server.url}/a", tmp_path / "part", nothing)
    server.most = 1 << 40
    download(f"{server.url}/b", tmp_path / "part", nothing)
    assert (tmp_path / "part").read_bytes() == CONTENT[::-1]


@pytest.mark.parametrize("name", [".p.bin.part", ".p.bin.part.json"])
def test_a_download_is_not_written_through_a_link(name: str, server: Server, tmp_path: Path) -> None:
    """Attack fetch_through_links."""
    server.files["/p"] = b"12345"
    (tmp_path / "mine").write_text("precious")
    (tmp_path / "ds").mkdir()
    (tmp_path / "ds" / name).symlink_to(tmp_path / "mine")
    piece = Piece("p.bin", f"{server.url}/p", packed=False)
    fetch_data_set(DataSet("ds", "T", "page", "licence", (piece,)), tmp_path, nothing, nothing)
    assert (tmp_path / "mine").read_text() == "precious"
    assert not (tmp_path / "ds" / "p.bin").is_symlink()
    assert (tmp_path / "ds" / "p.bin").read_bytes() == b"12345"


class Raw(socketserver.BaseRequestHandler):
    """Sends the server's pieces, whatever is asked."""

    def handle(self) -> None:
        self.request.recv(10_000)
        pieces, pause = self.server.pieces  # type: ignore[attr-defined]
        for piece in pieces:
            with suppress(OSError):
                self.request.sendall(piece)
            time.sleep(pause)


@pytest.fixture
def answering() -> Iterator[Callable[..., str]]:
    """Start a server that sends some bytes to whoever asks, piece by piece with pauses; returns its address."""
    with ExitStack() as stack:

        def start(*pieces: bytes, pause: float = 0.0) -> str:
            serving = stack.enter_context(socketserver.TCPServer(("127.0.0.1", 0), Raw))
            serving.pieces = pieces, pause  # type: ignore[attr-defined]
            thread = threading.Thread(target=serving.serve_forever, kwargs={"poll_interval": 0.01})
            thread.start()
            stack.callback(thread.join)
            stack.callback(serving.shutdown)
            return f"http://127.0.0.1:{serving.server_address[1]}/p"

        yield start


OK = b"HTTP/1.1 200 OK\r\n"


@pytest.mark.parametrize(
    "answer",
    [
        *(OK + b"Content-Length: %s\r\n\r\n12345" % length for length in (
            b"abc", b"5, 5", b"-1", b"1" + b"0" * 5000, b"", "²".encode("latin-1"), b"5\r\nContent-Length: 6",
        )),
        OK + b"\r\n12345",
        OK + b"Transfer-Encoding: chunked\r\n\r\n-5\r\n12345\r\n0\r\n\r\n",
        OK + b"Transfer-Encoding: chunked\r\n\r\nxyz\r\n12345\r\n0\r\n\r\n",
        OK + b"Content-Encoding: gzip\r\nContent-Length: 5\r\n\r\n12345",
        b"HTTP/1.1 302 Found\r\nLocation: http://[\r\nContent-Length: 0\r\n\r\n",
        b"HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 0-4/5\r\nContent-Length: 5\r\n\r\n12345",
        b"HTTP/1.1 204 No Content\r\n\r\n",
        b"nonsense\r\n\r\n",
    ],
)  # fmt: skip
def test_a_malformed_answer_is_one_kind_of_error_and_leaves_nothing(
    answer: bytes, answering: Callable[..., str], tmp_path: Path
) -> None:
    piece = Piece("p.bin", answering(answer), packed=False)
    with pytest.raises((MalformedAnswer, DownloadFailed)) as refused:
        download(piece.url, tmp_path / "a", nothing, timeout=5.0)
    assert not list(tmp_path.iterdir())
    assert exit_code(refused.value) == 3
    assert not getattr(refused.value, "unreachable", False)


def test_a_chunked_answer_is_complete_at_its_end_mark(answering: Callable[..., str], tmp_path: Path) -> None:
    head = OK + b"Transfer-Encoding: chunked\r\n\r\n5\r\n12345\r\n"
    download(answering(head + b"0\r\n\r\n"), tmp_path / "a", nothing)
    assert (tmp_path / "a").read_bytes() == b"12345"
    with pytest.raises(DownloadFailed, match="ended early"):
        download(answering(head), tmp_path / "b", nothing)


@pytest.mark.parametrize("begun", [b"HTTP/1.1 200", OK + b"Content-Length: 500000\r\n\r\n"])
def test_a_server_that_sends_byte_after_byte_is_given_up(
    begun: bytes, answering: Callable[..., str], tmp_path: Path
) -> None:
    """Each byte came within the time of a silent connection, so that it was waited for without end."""
    started = time.monotonic()
    with pytest.raises(DownloadFailed, match="fewer than 100 bytes a second"):
        download(answering(begun, *[b"1"] * 20, pause=0.1), tmp_path / "a", nothing, timeout=0.5)
    assert time.monotonic() - started < 5


@pytest.mark.parametrize(
    "note",
    [b"[]", b"x", b"{}", b'{"url": "URL", "version": "v"}', b'{"url": "URL", "version": "a\\nb", "bytes": 5}',
     b'{"url": "URL", "version": "v", "bytes": "5"}', b"[" * 100_000],
)  # fmt: skip
def test_a_note_of_an_earlier_download_that_is_damaged_begins_it_anew(
    note: bytes, server: Server, tmp_path: Path
) -> None:
    server.files["/a"] = CONTENT
    (tmp_path / "a").write_bytes(b"O" * 1000)
    (tmp_path / "a.json").write_bytes(note.replace(b"URL", f"{server.url}/a".encode()))
    download(f"{server.url}/a", tmp_path / "a", nothing)
    assert (tmp_path / "a").read_bytes() == CONTENT


@pytest.mark.parametrize("content", [b"[]", b"\xff", b"1", None])
def test_a_damaged_record_of_fetched_files_is_named(content: bytes | None, server: Server, tmp_path: Path) -> None:
    chosen = some_set(server)
    path = tmp_path / chosen.name / "fetched.json"
    path.parent.mkdir()
    path.mkdir() if content is None else path.write_bytes(content)
    with pytest.raises(DataError, match=r"fetched\.json is damaged"):
        fetch_data_set(chosen, tmp_path, nothing, nothing)


def archive(**members: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as zipped:
        for name, content in members.items():
            zipped.writestr(name.replace("__", "/"), content)
    return file.getvalue()


def some_set(server: Server, **of_lego: object) -> DataSet:
    server.files |= {"/lego.zip": archive(deep__lego__a=b"a", deep__lego__b=b"b"), "/sky.exr": b"sky"}
    lego = {"name": "lego.zip", "url": f"{server.url}/lego.zip", "into": "lego"} | of_lego
    return DataSet(
        "some-set", "Some set", "https://page.example", "stated there",
        (Piece(**lego), Piece("sky.exr", f"{server.url}/sky.exr", packed=False)),  # type: ignore[arg-type]
    )  # fmt: skip


def test_a_data_set_is_fetched_once_and_recorded(server: Server, tmp_path: Path) -> None:
    said: list[str] = []
    chosen = some_set(server)
    for _ in range(2):
        fetch_data_set(chosen, tmp_path, nothing, said.append)
    folder = tmp_path / "some-set"
    assert sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()) == [
        "fetched.json", "lego/a", "lego/b", "sky.exr",
    ]  # fmt: skip
    assert len(server.asked) == 2
    assert said[-2:] == ["lego.zip: is there", "sky.exr: is there"]
    assert sha256_of(folder / "sky.exr") in said[1]
    assert sha256_of(folder / "sky.exr") in (folder / "fetched.json").read_text()


@pytest.mark.parametrize(("given", "says"), [({"sha256": "0" * 64}, "not the published file"), ({"bytes": 9}, "bytes")])
def test_a_file_that_is_not_the_published_one_is_not_kept(
    given: dict[str, object], says: str, server: Server, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=says):
        fetch_data_set(some_set(server, **given), tmp_path, nothing, nothing)
    assert not list((tmp_path / "some-set").iterdir())


def test_without_a_network_files_to_fetch_and_their_places_are_listed(server: Server, tmp_path: Path) -> None:
    chosen = some_set(server)
    gone = DataSet("some-set", "Some set", "https://page.example", "", tuple(
        Piece(piece.name, piece.url.replace(str(server.server_port), "1"), piece.into, piece.packed)
        for piece in chosen.pieces
    ))  # fmt: skip
    with pytest.raises(NotFetched, match="2 of 2 files") as raised:
        fetch_data_set(gone, tmp_path, nothing, nothing)
    for piece in gone.pieces:
        assert f"  {piece.url}\n    put it at  {tmp_path / 'some-set' / piece.name}" in raised.value.why
    # Put there by hand, they are unpacked and kept.
    for piece in chosen.pieces:
        (tmp_path / "some-set" / piece.name).write_bytes(server.files[f"/{piece.name}"])
    fetch_data_set(gone, tmp_path, nothing, nothing)
    assert (tmp_path / "some-set" / "lego" / "b").read_bytes() == b"b"
    assert (tmp_path / "some-set" / "lego.zip").exists()


def test_a_missing_file_does_not_keep_the_others_from_being_fetched(server: Server, tmp_path: Path) -> None:
    chosen = some_set(server)
    del server.files["/lego.zip"]
    with pytest.raises(NotFetched, match="1 of 2 files") as raised:
        fetch_data_set(chosen, tmp_path, nothing, nothing)
    assert "404" in raised.value.why
    assert (tmp_path / "some-set" / "sky.exr").read_bytes() == b"sky"


def test_the_command_fetches_lists_and_has_an_exit_code_of_its_own(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("RADIOGS_BENCH_DATA", raising=False)
    monkeypatch.setattr(catalogue, "DATA_SETS", {"some-set": some_set(server)})
    assert main(["datasets", "fetch", "some-set", "--data", str(tmp_path / "new")]) == 0
    assert main(["datasets", "fetch", "some-sat", "--data", str(tmp_path)]) == 2
    assert main(["datasets", "fetch", "some-set"]) == 2
    assert main(["datasets", "fetch"]) == 0
    server.files.clear()
    assert main(["datasets", "fetch", "some-set", "--data", str(tmp_path)]) == 5
    said = capsys.readouterr()
    assert f"export RADIOGS_BENCH_DATA={tmp_path / 'new'}" in said.out
    assert "checksum unknown: recorded at first download" in said.out
    assert "(exit code 5)" in said.err
    assert f"put it at  {tmp_path / 'some-set' / 'lego.zip'}" in said.err


def test_a_capture_is_fetched_by_its_commit_and_its_licence_is_shown_before_and_after(
    server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, of, commit in CAPTURES:
        (piece,) = DATA_SETS[name].pieces
        assert piece.url == f"https://github.com/vork/{of}/archive/{commit}.zip"
        assert re.fullmatch("[0-9a-f]{40}", commit)
        server.files["/zip"] = archive(**{f"{of}-{commit}__{file}": b"1" for file in ("images__a.jpg", "LICENSE.md")})
        here = replace(DATA_SETS[name], pieces=(replace(piece, url=f"{server.url}/zip"),))
        monkeypatch.setattr(catalogue, "DATA_SETS", {name: here})
        assert main(["datasets", "fetch", name, "--data", str(tmp_path)]) == 0
        assert (tmp_path / name / "images" / "a.jpg").is_file()
        first, *_, last = [line for line in capsys.readouterr().out.splitlines() if "CC BY-NC-SA 4.0" in line]
        assert first.startswith(of)
        assert "is complete" in last


def test_every_suite_on_public_data_names_a_data_set_that_can_be_fetched() -> None:
    for each in SUITES.values():
        assert bool(each.download) == bool(each.data_set)
        assert not each.data_set or catalogue.data_set(each.data_set).pieces
    with pytest.raises(UsageError, match="Did you mean 'tensoir'"):
        catalogue.data_set("tensoor")


def test_the_catalogue_names_files_that_stay_in_their_folder() -> None:
    for each in DATA_SETS.values():
        names = [piece.name for piece in each.pieces]
        assert len(set(names)) == len(names)
        for piece in each.pieces:
            assert Path(piece.name).name == piece.name
            assert ".." not in Path(piece.into).parts
            assert not Path(piece.into).is_absolute()
            assert len(piece.sha256) in (0, 64)


def test_checksums_of_the_lights_match_the_published_files(shared_data: Path) -> None:
    for piece in DATA_SETS["synthetic4relight"].pieces:
        if piece.sha256:
            assert sha256_of(shared_data / "envmaps" / "synthetic4relight" / piece.name) == piece.sha256
