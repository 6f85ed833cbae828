"""Checks every stored file of a folder without changing any, and reports what a rerun would cost."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import torch

from radiogs_core.errors import DataError, ExplainedError
from radiogs_datasets.bounded_reading import TABLE_LIMIT, read_bytes
from radiogs_reports.summary import read_summary

from ..errors import StoreError
from ..runs.sweep import read_sweep
from ..runs.trained_folder import read_about
from ..store.folder import Store, product_name
from ..store.schema import Result
from ..store.seal import Broken, OtherSchema, complaint_of, parsed
from ..store.tensor_file import read_tensors
from .standing import WorkLeft, work_left

CPU = torch.device("cpu")

RECORDS = ("score.json", "mesh.json", "rehearsal.json")
"""Default names of the files that `score`, `export --mesh` and `rehearse` write."""


@dataclass(frozen=True)
class DamagedFile:
    """A file that differs from what was stored: its path within the folder, and the evidence of the difference."""

    path: str
    what: str


@dataclass
class Verified:
    """The findings. ``whole`` counts files that agree; ``others`` were written by another version."""

    findings: list[DamagedFile] = field(default_factory=list)
    whole: int = 0
    others: int = 0
    results: dict[str, Result] = field(default_factory=dict)
    """Whole results with whole arrays, by key."""
    products: set[str] = field(default_factory=set)
    """Keys of the stages whose products are whole."""
    rerun: WorkLeft | None = None
    """The work that the last run has left; None for a folder of `train`, and where the manifest cannot be used."""

    def look(self, path: str, check: Callable[[], object]) -> bool:
        """Whether a file passes a check, which raises for a damaged file."""
        try:
            check()
        except OtherSchema:
            self.others += 1
        except (Broken, FileNotFoundError, DataError, StoreError, ValueError, KeyError, TypeError) as error:
            self.findings.append(DamagedFile(path, _how(error)))
        else:
            self.whole += 1
            return True
        return False


def _how(error: Exception) -> str:
    """The evidence that a file differs from what was stored."""
    if isinstance(error, Broken):
        return str(error)
    if isinstance(error, FileNotFoundError):
        return "it is gone"
    return error.what if isinstance(error, ExplainedError) else f"{type(error).__name__}: {error}"


def verify(folder: Path) -> Verified:
    """Check all files with a seal, a digest or a name. Raises DataError for a folder without such files."""
    store, found = Store(folder), Verified()
    readers: Mapping[str, Callable[[Path], object]] = {
        "sweep.json": read_sweep, "trained.json": read_about, "summary.json": read_summary,
    }  # fmt: skip
    there = [name for name in readers if (folder / name).exists()]
    records = [path for path in sorted(folder.glob("*.json")) if path.name not in readers and _is_ours(path)]
    if not set(there) - {"summary.json"} and not store.result_keys() and not records:
        read_sweep(folder)  # says what to do where there is no run
    sound = {name for name in there if found.look(name, partial(readers[name], folder))}
    for path in records:
        found.look(path.name, partial(_require_seal, path))
    for key in store.result_keys():
        _look_at_cell(store, found, key)
    for key in store.failed_keys():
        found.look(f"cells/{key}.failed.json", partial(store.sealed_failure, key))
    for path in sorted((folder / "stages").glob("*.pt")):
        name = product_name(path.stem)
        if found.look(f"{name}.pt", partial(read_tensors, path, name, CPU)):
            found.products.add(path.stem)
    if "sweep.json" in sound:
        found.rerun = work_left(read_sweep(folder)["cells"], found.results, found.products)
    return found


def _is_ours(path: Path) -> bool:
    """Whether a command wrote this record: by its name, its schema or its seal (damage may hide one)."""
    try:
        content = read_bytes(path, TABLE_LIMIT)
    except DataError:
        return path.name in RECORDS
    return path.name in RECORDS or any(mark in content for mark in (b'"radiogs-bench/', b'"seal": "'))


def _require_seal(path: Path) -> None:
    """Raise Broken for a record whose content does not agree with its seal."""
    complaint = complaint_of(parsed(read_bytes(path, TABLE_LIMIT)))
    if complaint is not None:
        raise Broken(complaint)


def _look_at_cell(store: Store, found: Verified, key: str) -> None:
    if found.look(f"cells/{key}.json", partial(store.sealed_result, key)):
        result = store.sealed_result(key)
        if found.look(f"cells/{key}.npz", partial(store.check_arrays, result)):
            found.results[key] = result
