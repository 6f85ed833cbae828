"""Downloads the published LPIPS weights and checks their SHA-256 before they get their file name."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

from radiogs_core.errors import DataError, unknown

from ..errors import StoreError
from ..scoring.metrics.conventions import Net
from ..scoring.metrics.weights import missing_weights, weights_folder
from ..store.atomic import explained
from .catalogue import Piece
from .download import TIMEOUT, download, forget, require_published, sha256_of

TORCHVISION = "https://download.pytorch.org/models"
HEADS = (
    "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/"
    "082bb24f84c091ea94de2867d34c4544f68e0963/lpips/weights/v0.1"
)

OFFLINE_VARIABLE = "RADIOGS_BENCH_OFFLINE"
"""Environment variable: if it is set, commands download only what they are asked to download."""

PATIENCE = 10.0
"""Seconds without an answer after which a download that the user did not ask for is given up."""

MEGABYTES: Mapping[Net, int] = {"alex": 233, "vgg": 528, "squeeze": 5}
"""Size of the files of a network, rounded."""


def _files(features: str, net: Net, head: str) -> tuple[Piece, Piece]:
    """A network's features and its LPIPS head; torchvision's file names end in eight digits of their SHA-256."""
    digest = features.removesuffix(".pth").rsplit("-", 1)[1]
    name = f"{net}.pth"
    return Piece(features, f"{TORCHVISION}/{features}", sha256=digest), Piece(name, f"{HEADS}/{name}", sha256=head)


SOURCES: Mapping[Net, tuple[Piece, ...]] = {
    "alex": _files(
        "alexnet-owt-7be5be79.pth", "alex", "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0"
    ),
    "vgg": _files("vgg16-397923af.pth", "vgg", "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868"),
    "squeeze": _files(
        "squeezenet1_1-b8a52dc0.pth", "squeeze", "4a5350f23600cb79923ce65bb07cbf57dca461329894153e05a1346bd531cf76"
    ),
}
"""Torchvision's ImageNet weights (V1) and the LPIPS v0.1 heads (BSD-2-Clause)."""


def sources(nets: Sequence[str] | None = None) -> list[Piece]:
    """The files of the given networks, or of all. Raises UsageError for a network that LPIPS does not have."""
    for net in nets or ():
        if net not in SOURCES:
            raise unknown("network", net, SOURCES, of="LPIPS")
    return [source for net, files in SOURCES.items() if nets is None or net in nets for source in files]


def fetch(source: Piece, folder: Path, advance: Callable[[int, int], None], timeout: float = TIMEOUT) -> bool:
    """Download the file into ``folder`` unless a correct one is there; returns whether it was downloaded.

    ``advance`` is called with (done, total) bytes. The file gets its name once it is complete and its digest correct;
    an interrupted download starts again. Raises DataError if the server has no such file, cannot be reached, sends less
    than it promised or something else; StoreError if the folder cannot be written.
    """
    path = folder / source.name
    if path.is_file() and sha256_of(path).startswith(source.sha256):
        return False
    partial = path.with_name(f".{path.name}.part")
    with explained(path):
        folder.mkdir(parents=True, exist_ok=True)
    forget(partial)
    try:
        download(source.url, partial, advance, _by_hand(source, folder), timeout)
        require_published(partial, source.sha256, source.url, "Nothing was kept.", _by_hand(source, folder))
        with explained(path):
            partial.replace(path)
    finally:
        forget(partial)
    return True


def fetch_missing(nets: Iterable[Net], say: Callable[[str], None], advance: Callable[[str, int, int], None]) -> None:
    """Download the weights that given networks lack, once for this user, if there is a network.

    ``say`` receives what is fetched, or why it could not be; ``advance`` with (name, done, total) bytes. After a
    failure nothing more is tried.
    """
    if os.environ.get(OFFLINE_VARIABLE):
        return
    for net in filter(missing_weights, nets):
        say(f"fetching the weights of LPIPS ({net}), {MEGABYTES[net]} MB, into {weights_folder()}")
        try:
            for source in sources([net]):
                fetch(source, weights_folder(), partial(advance, source.name), PATIENCE)
        except (DataError, StoreError) as error:
            say(f"they could not be fetched: {error.what}")
            return


def _by_hand(source: Piece, folder: Path) -> str:
    return f"Try again later, or put a good copy at {folder / source.name} by hand."
