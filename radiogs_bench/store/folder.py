"""The store: a folder in which every file is complete and named by a hash of everything that decides its content.

    OUT/stages/<key>.pt             product of a stage of training, shared by all cells that begin alike
    OUT/stages/<key>.checkpoint.pt  state of an unfinished stage
    OUT/work/<key>/                 files that a method keeps while it trains (methods as commands)
    OUT/cells/<key>.json            scored result (``schema.Result``): if it exists, the cell is done
    OUT/cells/<key>.npz             maps of one view, written before the JSON
    OUT/cells/<key>.failed.json     why a cell failed (``schema.Failure``), until it succeeds
    OUT/tracebacks/<digest>.txt     what a method raised, whole
    OUT/aside/                      files that were found damaged

Tables and figures are rebuilt from the results alone. Stores of several machines merge by copying files together.
"""

import hashlib
import io
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import torch

from radiogs_core.own_files import require_own_folders

from ..errors import MethodFailed
from .atomic import write_atomically
from .claim import claim, is_held
from .keys import content_key, plain_name
from .opening import explained_reading, opened
from .schema import RESULT_SCHEMA, Failure, Result, contradiction
from .seal import Broken, OtherSchema, read_sealed, write_sealed
from .tensor_file import packed, read_tensors

logger = logging.getLogger(__name__)

T = TypeVar("T")

ASIDE = "aside"
"""The folder to which damaged files are moved: nothing is lost there."""

FOLDERS = (ASIDE, "cells", "locks", "stages", "tracebacks", "work")
"""Folders of a store; their files are named by keys, and none replaces another's."""

RESULT_KEYS = frozenset(Result.__required_keys__) | {"arrays"}
FAILURE_KEYS = frozenset(Failure.__required_keys__)


class Store:
    """A folder of results; it is created when first written to."""

    def __init__(self, folder: Path) -> None:
        """Raises UsageError for a folder of ``FOLDERS`` that is a link."""
        require_own_folders(folder, *FOLDERS)
        self.folder = folder
        self._agreed: dict[str, tuple[int, ...]] = {}
        """Size and times of array files with a verified digest, by digest, so that each file is read only once."""

    def claim(self, name: str) -> AbstractContextManager[None]:
        """Exclusive right to work on a key, until the block ends or the process dies. Raises Claimed."""
        return claim(self.folder / "locks" / name)

    def workspace(self, key: str) -> Path:
        """The folder for the files of a cell's method, by the key of its last stage. Raises UsageError for a link."""
        require_own_folders(self.folder, f"work/{key}")
        return self.folder / "work" / key

    def is_claimed(self, name: str) -> bool:
        """Whether another process holds the claim at this moment."""
        return is_held(self.folder / "locks" / name)

    def remove_leavings(self) -> None:
        """Remove temporary files and notes of progress of killed processes: their claims are free."""
        for folder, claim_on in (("stages", stage_claim), ("cells", str), ("locks", str)):
            for path in [*(self.folder / folder).glob(".*.tmp"), *(self.folder / folder).glob("*.pace")]:
                if not self.is_claimed(claim_on(path.name.removeprefix(".").partition(".")[0])):
                    path.unlink(missing_ok=True)

    def patient_claim(self, name: str) -> AbstractContextManager[None]:
        """Exclusive right to work on a key, waiting until it is free; for short work."""
        return claim(self.folder / "locks" / name, wait=-1.0)

    def result(self, key: str) -> Result | None:
        """The finished result of a cell, or None. A file that does not agree with its seal is moved aside.

        A result whose array file is missing or has another digest is not finished. Raises OtherSchema for a result of
        another version, StoreError where the folder cannot be read.
        """
        stored, arrays = self._sound(self._cell_path(key), lambda: self.sealed_result(key)), self.arrays_path(key)
        if stored is None:
            return None
        if not arrays.exists():
            logger.warning("%s is gone: cell %s counts as not finished", arrays, key)
        return self._sound(arrays, lambda: self.check_arrays(stored))

    def _sound(self, path: Path, read: Callable[[], T]) -> T | None:
        """The content of a file; None if it is missing, or damaged and then moved aside."""
        try:
            return read()
        except FileNotFoundError:
            return None
        except Broken as broken:
            set_aside(self.folder, path, str(broken))
            return None

    def sealed_result(self, key: str) -> Result:
        """The result of a cell; no file is moved. Raises FileNotFoundError, Broken, OtherSchema, StoreError."""
        stored = read_sealed(self._cell_path(key), RESULT_SCHEMA, RESULT_KEYS, Result)
        if stored["key"] != key or content_key(stored["cell"]) != key:
            raise Broken(f"it is not the result of cell {key}")
        result = cast(Result, stored)
        if wrong := contradiction(result):
            raise Broken(wrong)
        return result

    def check_arrays(self, result: Result) -> Result:
        """The result, if its array file has the digest in it. Raises FileNotFoundError, Broken, StoreError."""
        path, named = self.arrays_path(result["key"]), result["arrays"]
        with explained_reading(path), opened(path) as file:
            stat = os.fstat(file.fileno())
            mark = (stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
            if self._agreed.get(named) == mark:
                return result
            found = hashlib.file_digest(file, "sha256").hexdigest()
        if found != named:
            raise Broken("its digest is not the one that its cell names")
        self._agreed[named] = mark
        return result

    def has_result(self, key: str) -> bool:
        """Whether the files of the cell's result exist; they are not read."""
        return self._cell_path(key).exists() and self.arrays_path(key).exists()

    def results(self) -> Iterator[Result]:
        """All finished results of this schema, in the order of their keys."""
        for key in self.result_keys():
            try:
                stored = self.result(key)
            except OtherSchema as other:
                logger.warning("%s; it is left alone", other.what)
                continue
            if stored is not None:
                yield stored

    def result_keys(self) -> list[str]:
        """Keys of all cells that have a result file, in order."""
        return sorted({path.stem for path in self._json_files()} - {f"{key}.failed" for key in self.failed_keys()})

    def failed_keys(self) -> list[str]:
        """Keys of all cells that have a failure, in order."""
        return sorted(path.stem.removesuffix(".failed") for path in self._json_files() if path.stem.endswith(".failed"))

    def _json_files(self) -> Iterator[Path]:
        return (path for path in (self.folder / "cells").glob("*.json") if not path.name.startswith("."))

    def put_result(self, result: Result, arrays: Mapping[str, np.ndarray]) -> None:
        """Store a finished cell: first its arrays, then the JSON, which names their digest and marks it complete."""
        file = io.BytesIO()
        np.savez_compressed(file, allow_pickle=False, **arrays)
        key, content = result["key"], file.getvalue()
        self._cell_path(key).unlink(missing_ok=True)  # of arrays that are gone: it must not stand beside new ones
        write_atomically(self.arrays_path(key), content)
        whole = {**result, "arrays": hashlib.sha256(content).hexdigest()}
        write_sealed(self._cell_path(key), whole)
        self.drop_failure(key)

    def arrays_path(self, key: str) -> Path:
        """Path of the arrays of a finished cell."""
        return self._cell_path(key).with_suffix(".npz")

    def failure(self, key: str) -> Failure | None:
        """The failure of the cell in its last attempt, or None."""
        return self._sound(self._failure_path(key), lambda: self.sealed_failure(key))

    def sealed_failure(self, key: str) -> Failure:
        """The failure of a cell, with a valid seal; no file is moved. Raises as ``sealed_result`` does."""
        stored = read_sealed(self._failure_path(key), RESULT_SCHEMA, FAILURE_KEYS, Failure)
        if stored["key"] != key:
            raise Broken(f"it is not the failure of cell {key}")
        return cast(Failure, stored)

    def put_failure(self, failure: Failure) -> None:
        """Store why a cell failed."""
        write_sealed(self._failure_path(failure["key"]), failure)

    @contextmanager
    def keeping_tracebacks(self) -> Iterator[None]:
        """Context that re-raises a method's failure with the path of its stored traceback."""
        try:
            yield
        except MethodFailed as failure:
            raise self.with_traceback(failure) from failure

    def with_traceback(self, failure: MethodFailed) -> MethodFailed:
        """The failure with the path of its traceback, which is stored once, under a digest of its content."""
        if not failure.trace:
            return failure
        content = failure.trace.encode(errors="replace")
        path = self.folder / "tracebacks" / f"{hashlib.sha256(content).hexdigest()[:12]}.txt"
        with self.patient_claim(path.name):
            if not path.exists():
                write_atomically(path, content)
        remedy = f"{failure.remedy} The whole traceback: {path}".strip()
        return type(failure)(failure.what, failure.why, remedy)

    def tensors(self, name: str, device: torch.device) -> dict[str, Any] | None:
        """The content that ``put_tensors`` stored under ``name``, or None; a damaged file is moved aside and is absent.

        Tensors saved from a GPU are loaded to ``device``; those saved from the CPU (random states) stay there.
        """
        path = self._tensors_path(name)
        return self._sound(path, lambda: read_tensors(path, name, device))

    def put_tensors(self, name: str, content: Mapping[str, Any]) -> None:
        """Store tensors and plain values under a name such as ``stages/<key>``."""
        write_atomically(self._tensors_path(name), packed(name, content))

    def has_tensors(self, name: str) -> bool:
        """Whether a file exists under the name; it is not read."""
        return self._tensors_path(name).exists()

    def drop_tensors(self, name: str) -> None:
        """Remove what is stored under a name, if anything is (a checkpoint whose stage has ended)."""
        self._tensors_path(name).unlink(missing_ok=True)

    def files(self, names: Iterable[str]) -> dict[str, bytes]:
        """Contents of the named files (paths within the store) that exist."""
        there = [name for name in names if (self.folder / name).exists()]
        contents = {}
        for name in there:
            with opened(self.folder / name) as file:
                contents[name] = file.read()
        return contents

    def take_over(self, files: Mapping[str, bytes]) -> None:
        """Write files of another store, in their order: a result must come after its arrays."""
        for name in files:
            (self.folder / name).unlink(missing_ok=True)  # as in ``put_result``
        for name, content in files.items():
            write_atomically(self.folder / name, content)

    def drop_failure(self, key: str) -> None:
        """Remove the failure of a cell that has succeeded."""
        self._failure_path(key).unlink(missing_ok=True)

    def _cell_path(self, key: str) -> Path:
        return self.folder / "cells" / f"{plain_name(key, 'the key of a cell')}.json"

    def _failure_path(self, key: str) -> Path:
        return self._cell_path(key).with_suffix(".failed.json")

    def _tensors_path(self, name: str) -> Path:
        parts = [plain_name(part, "the name of stored tensors") for part in name.split("/")]
        return self.folder.joinpath(*parts[:-1], f"{parts[-1]}.pt")


def product_name(key: str) -> str:
    """Name of a stage's product in a store."""
    return f"stages/{key}"


def stage_claim(key: str) -> str:
    """Name of the claim on a stage, or on its start, while it is being made."""
    return f"stages-{key}"


def checkpoint_name(key: str) -> str:
    """Name of an unfinished stage's checkpoint in a store."""
    return f"{product_name(key)}.checkpoint"


def set_aside(folder: Path, path: Path, reason: str) -> None:
    """Move a damaged file of the store aside, never over another one; if that fails, it stays, unused."""
    aside = folder / ASIDE
    try:
        aside.mkdir(exist_ok=True)
        taken = sum(1 for other in aside.iterdir() if other.name.startswith(path.name))
        with suppress(FileNotFoundError):  # another process has just moved it
            path.rename(aside / f"{path.name}.{taken}")
    except OSError as error:
        logger.warning("%s is damaged (%s) and is not used; it cannot be moved: %s", path, reason, error.strerror)
        return
    logger.warning("%s is damaged (%s); it was moved to %s and is not used", path, reason, aside)


def kept_aside(folder: Path) -> list[str]:
    """Names of the files in ``folder``/aside."""
    aside = folder / ASIDE
    try:
        return sorted(path.name for path in aside.iterdir())
    except OSError:
        return []
