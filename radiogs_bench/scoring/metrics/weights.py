"""The published weights of LPIPS: folder, file names, and reading."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor

from radiogs_core.errors import DataError

from .conventions import Net

WEIGHTS_VARIABLE = "RADIOGS_BENCH_WEIGHTS"

UNREADABLE = (
    OSError, ValueError, EOFError, RuntimeError, LookupError, AttributeError, TypeError, UnpicklingError, BadZipFile
)  # fmt: skip
"""Errors that torch's restricted unpickler and numpy raise for files that are not archives."""

NO_WEIGHTS = "the published LPIPS weights"
"""First words of the reason why LPIPS has no value."""

DOWNLOAD = "Fetch them:  radiogs-bench datasets weights"


@dataclass(frozen=True)
class Files:
    """Names under which a network's features and its LPIPS head are looked for, in this order."""

    features: tuple[str, ...]
    head: tuple[str, ...]


FILES: Mapping[Net, Files] = {
    "alex": Files(("alexnet_features.npz", "alexnet-owt-7be5be79.pth"), ("heads/alex.pth", "alex.pth")),
    "vgg": Files(("vgg16_features.npz", "vgg16-397923af.pth"), ("heads/vgg.pth", "vgg.pth")),
    "squeeze": Files(
        ("squeezenet1_1_features.npz", "squeezenet1_1-b8a52dc0.pth"), ("heads/squeeze.pth", "squeeze.pth")
    ),
}


def weights_folder() -> Path:
    """The folder of the weights: the variable RADIOGS_BENCH_WEIGHTS, else the user's cache."""
    named = os.environ.get(WEIGHTS_VARIABLE)
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(named) if named else cache_home / "radiogs-bench" / "weights"


def missing_weights(net: Net = "alex") -> str:
    """Why LPIPS with this network is unavailable; empty if available. Stored in results, so it contains no path."""
    if not lacking(net):
        return ""
    return f"{NO_WEIGHTS} of {net} were not found; radiogs-bench datasets weights fetches them"


def lacking(net: Net) -> str:
    """The missing file, with its folder; empty if all exist. For messages, not for results."""
    folder = weights_folder()
    for names in (FILES[net].features, FILES[net].head):
        if _first(folder, names) is None:
            return f"{folder} has neither {' nor '.join(names)}"
    return ""


def complaint(net: Net) -> str:
    """The message about missing weights; empty if none is missing."""
    missing = lacking(net)
    return f"LPIPS ({net}) is n/a: {missing}. {DOWNLOAD}" if missing else ""


def read_weights(net: Net, folder: Path) -> tuple[dict[str, Tensor], list[Tensor]]:
    """Convolutions by torchvision's names, and the head's weights [1, channels, 1, 1] by layer. Raises DataError."""
    features, head = _first(folder, FILES[net].features), _first(folder, FILES[net].head)
    if features is None or head is None:
        raise DataError(f"LPIPS weights of {net} not found", f"{lacking(net)}.", DOWNLOAD)
    loaded = _tensors(head)
    layers = sorted(name for name in loaded if name.startswith("lin"))
    return _tensors(features), [loaded[name].float() for name in layers]


def _tensors(path: Path) -> dict[str, Tensor]:
    try:
        if path.suffix == ".npz":
            with np.load(path) as archive:
                return {name: torch.from_numpy(archive[name]) for name in archive.files}
        return torch.load(path, map_location="cpu", weights_only=True)
    except UNREADABLE as failure:
        raise DataError(f"cannot read the weights {path}", str(failure), DOWNLOAD) from failure


def _first(folder: Path, names: tuple[str, ...]) -> Path | None:
    return next((folder / name for name in names if (folder / name).is_file()), None)
