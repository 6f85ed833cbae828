"""LPIPS against published distances, and its weights, which are downloaded whole or not at all."""

import hashlib
import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from metrics.images import example
from radiogs_bench.cli import main
from radiogs_bench.fetching import lpips_weights
from radiogs_bench.fetching.catalogue import Piece
from radiogs_bench.fetching.lpips_weights import OFFLINE_VARIABLE, SOURCES, fetch, fetch_missing
from radiogs_bench.scoring.metrics.conventions import Lpips, Net
from radiogs_bench.scoring.metrics.lpips import BACKBONES, SMALLEST_SIDE, distance, lpips
from radiogs_bench.scoring.metrics.protocols import protocol
from radiogs_bench.scoring.metrics.weights import FILES, lacking, missing_weights
from radiogs_core.errors import DataError

PUBLISHED = {
    "alex": {"ex_p0": 0.721881, "ex_p1": 0.137566, "ex_ref": 0.0},
    "squeeze": {"ex_p0": 0.711048, "ex_p1": 0.147902, "ex_ref": 0.0},
}
"""Measured with the reference implementation's formula; the two of AlexNet are also printed in its documentation."""


@pytest.mark.parametrize(("net", "other"), [(net, other) for net in PUBLISHED for other in PUBLISHED[net]])
def test_published_distances(shared_data: Path, monkeypatch: pytest.MonkeyPatch, net: Net, other: str) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(shared_data / "lpips"))
    found = lpips(example(shared_data, "ex_ref"), example(shared_data, other), Lpips(net))
    assert found == pytest.approx(PUBLISHED[net][other], abs=1e-5)


def test_squeezenet_gives_torchmetrics_documented_distances(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """[0.1024, 0.0938]: two pairs of random images in [-1, 1], from a generator seeded 42."""
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(shared_data / "lpips"))
    generator = torch.Generator().manual_seed(42)
    first, second = (torch.rand(2, 3, 100, 100, generator=generator) for _ in range(2))
    found = [
        lpips(first[place].permute(1, 2, 0), second[place].permute(1, 2, 0), Lpips("squeeze")) for place in range(2)
    ]
    assert found == pytest.approx([0.1024, 0.0938], abs=5e-5)


def test_feeding_zero_to_one_is_another_metric(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(shared_data / "lpips"))
    pair = example(shared_data, "ex_ref"), example(shared_data, "ex_p0")
    raw = lpips(*pair, Lpips("alex", "[0, 1]"))
    # The same as the expected input for images whose values are (x + 1) / 2.
    halved = lpips((pair[0] + 1) / 2, (pair[1] + 1) / 2, Lpips("alex"))
    assert raw == pytest.approx(halved, abs=1e-5)
    assert abs(raw - PUBLISHED["alex"]["ex_p0"]) > 1e-3


class Fire(nn.Module):
    def __init__(self, channels: int, squeezed: int, expanded: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(channels, squeezed, 1)
        self.expand1x1 = nn.Conv2d(squeezed, expanded, 1)
        self.expand3x3 = nn.Conv2d(squeezed, expanded, 3, padding=1)

    def forward(self, value: torch.Tensor) -> torch.Tensor:
        value = self.squeeze(value).relu()
        return torch.cat([self.expand1x1(value).relu(), self.expand3x3(value).relu()], 1)


def architecture(net: Net) -> tuple[nn.Sequential, list[int]]:
    """The network as its paper and torchvision list it, layer after layer, and the layers that LPIPS taps."""
    if net == "vgg":  # configuration D of Simonyan and Zisserman
        plan: list[int | str] = [64, 64, "M", 128, 128, "M", 256, 256, 256, "M", 512, 512, 512, "M", 512, 512, 512]
        layers: list[nn.Module] = []
        channels = 3
        for entry in plan:
            if isinstance(entry, str):
                layers.append(nn.MaxPool2d(2, 2))
            else:
                layers += [nn.Conv2d(channels, entry, 3, padding=1), nn.ReLU()]
                channels = entry
        return nn.Sequential(*layers), [3, 8, 15, 22, 29]
    if net == "alex":
        return nn.Sequential(
            nn.Conv2d(3, 64, 11, stride=4, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2),
            nn.Conv2d(64, 192, 5, padding=2), nn.ReLU(), nn.MaxPool2d(3, 2),
            nn.Conv2d(192, 384, 3, padding=1), nn.ReLU(),
            nn.Conv2d(384, 256, 3, padding=1), nn.ReLU(),
            nn.Conv2d(256, 256, 3, padding=1), nn.ReLU(),
        ), [1, 4, 7, 9, 11]  # fmt: skip
    return nn.Sequential(
        nn.Conv2d(3, 64, 3, stride=2), nn.ReLU(), nn.MaxPool2d(3, 2, ceil_mode=True),
        Fire(64, 16, 64), Fire(128, 16, 64), nn.MaxPool2d(3, 2, ceil_mode=True),
        Fire(128, 32, 128), Fire(256, 32, 128), nn.MaxPool2d(3, 2, ceil_mode=True),
        Fire(256, 48, 192), Fire(384, 48, 192), Fire(384, 64, 256), Fire(512, 64, 256),
    ), [1, 4, 7, 9, 10, 11, 12]  # fmt: skip


@pytest.mark.parametrize("net", BACKBONES)
def test_the_networks_are_torchs_own_layers(net: Net) -> None:
    """Random weights: VGG16's published weights are not at hand, so its architecture is judged by nn.Sequential."""
    network, taps = architecture(net)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=1.5 / max(1, parameter[0].numel()) ** 0.5)
    image, other = torch.randn(1, 3, 61, 74), torch.randn(1, 3, 61, 74)
    weights = {f"features.{name}": value for name, value in network.state_dict().items()}
    with torch.no_grad():
        value, activations = image, []
        for place, layer in enumerate(network):
            value = layer(value)
            if place in taps:
                activations.append(value)
        for found, expected in zip(BACKBONES[net](image, weights), activations, strict=True):
            torch.testing.assert_close(found, expected)
        assert len(activations) == len(taps)

        heads = [torch.rand(1, value.shape[1], 1, 1) for value in activations]
        found_distance = distance(image, other, net, weights, heads)
        total, ours, theirs = 0.0, image, other
        remaining = iter(heads)
        for place, layer in enumerate(network):
            ours, theirs = layer(ours), layer(theirs)
            if place in taps:
                a, b = (nn.functional.normalize(side.double(), dim=1, eps=1e-10) for side in (ours, theirs))
                total += float(torch.einsum("c,bchw->bhw", next(remaining)[0, :, 0, 0].double(), (a - b) ** 2).mean())
    assert found_distance == pytest.approx(total, rel=1e-4)


@pytest.mark.parametrize("net", BACKBONES)
def test_the_smallest_image_is_large_enough(net: Net) -> None:
    network, taps = architecture(net)
    weights = {f"features.{name}": value for name, value in network.state_dict().items()}
    side = SMALLEST_SIDE[net]
    with torch.no_grad():
        assert len(list(BACKBONES[net](torch.rand(1, 3, side, side), weights))) == len(taps)


def test_torchvisions_file_is_read_as_the_archive_is(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A .pth beside its head, both at the top of the folder, as the download command leaves them."""
    with np.load(shared_data / "lpips" / "alexnet_features.npz") as archive:
        torch.save(
            {name: torch.from_numpy(archive[name]) for name in archive.files}, tmp_path / FILES["alex"].features[1]
        )
    (tmp_path / "alex.pth").write_bytes((shared_data / "lpips" / "heads" / "alex.pth").read_bytes())
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    found = lpips(example(shared_data, "ex_ref"), example(shared_data, "ex_p0"))
    assert found == pytest.approx(0.721881, abs=1e-5)


@pytest.mark.parametrize("net", BACKBONES)
def test_missing_weights_are_named_with_their_remedy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, net: Net) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    reason = missing_weights(net)
    assert net in reason
    assert "radiogs-bench datasets weights" in reason
    assert str(tmp_path) not in reason  # results keep it, and are sent around
    assert str(tmp_path) in lacking(net)
    with pytest.raises(DataError, match=f"(?s)not found.*{tmp_path}.*datasets weights"):
        lpips(torch.rand(40, 40, 3), torch.rand(40, 40, 3), Lpips(net))


def test_without_weights_every_protocol_says_so_and_scores_the_rest(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    for name in ("default", "radiogs", "tensoir", "stanford-orb"):
        found = protocol(name).score_image(torch.rand(32, 32, 3), torch.rand(32, 32, 3))
        assert found["lpips"].value is None
        assert "not found" in found["lpips"].reason
        assert found["ssim"].value is not None


def test_damaged_weights_are_an_error_and_not_a_score(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    for name in itertools.chain(FILES["alex"].features[:1], FILES["alex"].head[1:]):
        (tmp_path / name).write_bytes(b"this is no archive")
    with pytest.raises(DataError, match="cannot read the weights"):
        lpips(torch.rand(40, 40, 3), torch.rand(40, 40, 3))


def test_weights_of_another_network_are_named(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    alexnet = shared_data / "lpips" / "alexnet_features.npz"
    (tmp_path / "vgg16_features.npz").write_bytes(alexnet.read_bytes())
    (tmp_path / "vgg.pth").write_bytes((shared_data / "lpips" / "heads" / "vgg.pth").read_bytes())
    with pytest.raises(DataError, match=r"lack 'features.2.weight'"):
        lpips(torch.rand(40, 40, 3), torch.rand(40, 40, 3), Lpips("vgg"))


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
        source = Piece("net.pth", f"{server}/good", sha256=DIGEST[:8])
        assert fetch(source, tmp_path / "new", lambda done, total: told.append((done, total)))
        assert not fetch(source, tmp_path / "new", nothing)
    assert (tmp_path / "new" / "net.pth").read_bytes() == CONTENT
    assert told[-1] == (len(CONTENT), len(CONTENT))
    assert Answers.asked == ["/good"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["net.pth"]


def test_a_damaged_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "net.pth").write_bytes(b"half")
    with serving() as server:
        assert fetch(Piece("net.pth", f"{server}/good", sha256=DIGEST), tmp_path, nothing)
    assert (tmp_path / "net.pth").read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("path", "complaint"),
    [("/gone", "404"), ("/short", r"100 of \d+ bytes"), ("/wrong", f"not with {DIGEST[:8]}"), ("/stuck", "timed out")],
)
def test_wrong_downloads_are_errors_and_leave_no_file(tmp_path: Path, path: str, complaint: str) -> None:
    with serving() as server, pytest.raises(DataError, match=complaint) as raised:
        fetch(Piece("net.pth", f"{server}{path}", sha256=DIGEST[:8]), tmp_path, nothing, timeout=0.2)
    assert server in raised.value.what
    assert raised.value.remedy
    assert not list(tmp_path.iterdir())


def test_a_failed_download_keeps_the_file_that_was_there(tmp_path: Path) -> None:
    (tmp_path / "net.pth").write_bytes(b"old")
    with serving() as server, pytest.raises(DataError):
        fetch(Piece("net.pth", f"{server}/gone", sha256=DIGEST), tmp_path, nothing)
    assert (tmp_path / "net.pth").read_bytes() == b"old"


def test_a_server_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with serving() as server:
        pass
    with pytest.raises(DataError, match="refused"):
        fetch(Piece("net.pth", f"{server}/good", sha256=DIGEST), tmp_path, nothing)


def test_fetched_files_have_the_expected_names() -> None:
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
def test_a_run_fetches_missing_weights_until_a_failure_unless_forbidden(
    path: str, offline: str, said: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failure is reported once, and ends the downloads; SqueezeNet's weights exist."""
    monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path))
    monkeypatch.setenv(OFFLINE_VARIABLE, offline)
    for name in (FILES["squeeze"].features[0], FILES["squeeze"].head[-1]):
        (tmp_path / name).write_bytes(CONTENT)
    lines: list[str] = []
    with serving() as server:
        files = {
            net: tuple(Piece(each.name, f"{server}{path}", sha256=DIGEST) for each in of) for net, of in SOURCES.items()
        }
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
        alex = Piece("a.pth", f"{server}/good", sha256=DIGEST)
        monkeypatch.setattr(lpips_weights, "SOURCES", {"alex": (alex,), "vgg": (), "squeeze": ()})
        monkeypatch.setenv("RADIOGS_BENCH_WEIGHTS", str(tmp_path / "cache"))
        assert main(["datasets", "weights"]) == 0
        assert main(["datasets", "weights", "--nets", "alex"]) == 0
        assert main(["datasets", "weights", "--to", str(tmp_path / "other")]) == 0
        assert main(["datasets", "weights", "--nets", "alexnet"]) == 2
        monkeypatch.setattr(lpips_weights, "SOURCES", {"alex": (Piece("b.pth", f"{server}/gone", sha256=DIGEST),)})
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


def test_the_heads_digests_match_the_published_files(shared_data: Path) -> None:
    for _, head in SOURCES.values():
        content = (shared_data / "lpips" / "heads" / head.name).read_bytes()
        assert hashlib.sha256(content).hexdigest() == head.sha256
