"""Weights come from a server that may be good, short, wrong, slow or gone; only the right file is kept."""

import hashlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from radiogs_bench.cli import main
from radiogs_bench.fetching import lpips_weights
from radiogs_bench.fetching.lpips_weights import OFFLINE_VARIABLE, SOURCES, Source, fetch, fetch_missing
from radiogs_bench.scoring.metrics.weights import FILES
from radiogs_core.errors import DataError

CONTENT = bytes(range(256)) * 40
DIGEST = hashlib.sha256(CONTENT).hexdigest()


class Answers(BaseHTTPRequestHandler):
    asked: list[str]

    def do_GET(self) -> None:
        self.asked.append(self.path)
        if self.path == "/gone":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        if self.path == "/stuck":
            self.wfile.write(CONTENT[:10])
            self.wfile.flush()
            threading.Event().wait(0.5)
        elif self.path == "/short":
            self.wfile.write(CONTENT[:100])
        else:
            self.wfile.write(CONTENT if self.path == "/good" else CONTENT[::-1])

    def log_message(self, format: str, *arguments: object) -> None:
        pass


@contextmanager
def serving() -> Iterator[str]:
    Answers.asked = []
    server = HTTPServer(("127.0.0.1", 0), Answers)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def nothing(done: int, total: int) -> None:
    pass


def test_a_good_file_is_kept_once_and_its_progress_told(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    with serving() as server:
        source = Source(f"{server}/good", "net.pth", DIGEST[:8])
        assert fetch(source, tmp_path / "new", lambda done, total: told.append((done, total)))
        assert not fetch(source, tmp_path / "new", nothing)
    assert (tmp_path / "new" / "net.pth").read_bytes() == CONTENT
    assert told[-1] == (len(CONTENT), len(CONTENT))
    assert Answers.asked == ["/good"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["net.pth"]


def test_a_damaged_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "net.pth").write_bytes(b"half")
    with serving() as server:
        assert fetch(Source(f"{server}/good", "net.pth", DIGEST), tmp_path, nothing)
    assert (tmp_path / "net.pth").read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("path", "complaint"),
    [
        ("/gone", "404"),
        ("/short", r"100 of \d+ bytes"),
        ("/wrong", f"not with {DIGEST[:8]}"),
        ("/stuck", "timed out"),
    ],
)
def test_anything_else_is_an_error_that_leaves_nothing_behind(tmp_path: Path, path: str, complaint: str) -> None:
    with serving() as server, pytest.raises(DataError, match=complaint) as raised:
        fetch(Source(f"{server}{path}", "net.pth", DIGEST[:8]), tmp_path, nothing, timeout=0.2)
    assert server in raised.value.what
    assert raised.value.remedy
    assert not list(tmp_path.iterdir())


def test_a_failed_download_keeps_the_file_that_was_there(tmp_path: Path) -> None:
    (tmp_path / "net.pth").write_bytes(b"old")
    with serving() as server, pytest.raises(DataError):
        fetch(Source(f"{server}/gone", "net.pth", DIGEST), tmp_path, nothing)
    assert (tmp_path / "net.pth").read_bytes() == b"old"


def test_a_server_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with serving() as server:
        pass
    with pytest.raises(DataError, match="refused"):
        fetch(Source(f"{server}/good", "net.pth", DIGEST), tmp_path, nothing)


def test_what_is_fetched_is_what_is_looked_for() -> None:
    for net, sources in SOURCES.items():
        features, head = sources
        assert features.name in FILES[net].features
        assert head.name in FILES[net].head
        assert len(features.sha256) == 8
        assert len(head.sha256) == 64
        assert all(source.url.startswith("https://") and source.url.endswith(source.name) for source in sources)


@pytest.mark.parametrize(
    ("path", "offline", "said"),
    [
        ("/good", "", ["fetching the weights of LPIPS (alex), 233 MB", "fetching the weights of LPIPS (vgg), 528 MB"]),
        ("/gone", "", ["fetching the weights of LPIPS (alex)", "they could not be fetched"]),
        ("/good", "1", []),
    ],
)
def test_a_run_fetches_what_its_networks_lack_until_a_failure_unless_told_not_to(
    path: str, offline: str, said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failure is said once, and ends it; SqueezeNet is there."""
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    monkeypatch.setenv(OFFLINE_VARIABLE, offline)
    for name in (FILES["squeeze"].features[0], FILES["squeeze"].head[-1]):
        (tmp_path / name).write_bytes(CONTENT)
    lines: list[str] = []
    with serving() as server:
        files = {net: tuple(Source(f"{server}{path}", each.name, DIGEST) for each in SOURCES[net]) for net in SOURCES}
        monkeypatch.setattr(lpips_weights, "SOURCES", files)
        fetch_missing(["squeeze", "alex", "vgg"], lines.append, lambda name, done, total: None)
    assert [line[: len(begin)] for line, begin in zip(lines, said, strict=True)] == said
    wanted = [] if offline or path == "/gone" else [each.name for net in ("alex", "vgg") for each in SOURCES[net]]
    assert sorted(each.name for each in tmp_path.iterdir() if "squeeze" not in each.name) == sorted(wanted)
    assert len(Answers.asked) == (0 if offline else 1 if path == "/gone" else 4)


def test_the_command_fetches_what_is_asked_for_and_says_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving() as server:
        monkeypatch.setattr(
            lpips_weights, "SOURCES", {"alex": (Source(f"{server}/good", "a.pth", DIGEST),), "vgg": (), "squeeze": ()}
        )
        monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path / "cache"))
        assert main(["datasets", "weights"]) == 0
        assert main(["datasets", "weights", "--nets", "alex"]) == 0
        assert main(["datasets", "weights", "--to", str(tmp_path / "other")]) == 0
        assert main(["datasets", "weights", "--nets", "alexnet"]) == 2
        monkeypatch.setattr(lpips_weights, "SOURCES", {"alex": (Source(f"{server}/gone", "b.pth", DIGEST),)})
        assert main(["datasets", "weights"]) == 3
    assert (tmp_path / "cache" / "a.pth").read_bytes() == (tmp_path / "other" / "a.pth").read_bytes() == CONTENT
    shown = "".join(capsys.readouterr())
    for expected in (
        "fetched from",
        "is there",
        "export RADIOGS_BENCH_WEIGHTS=",
        "Did you mean 'alex'",
        "404",
        "(exit code 3)",
    ):
        assert expected in shown


def test_the_heads_digests_are_those_of_the_published_files(shared_data: Path) -> None:
    for _, head in SOURCES.values():
        content = (shared_data / "lpips" / "heads" / head.name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == head.sha256
