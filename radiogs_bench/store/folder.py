"""The store: a folder in which every file is complete and named by a key over what decides its content.

    OUT/stages/<key>.pt             product of a stage of training, shared by all cells that begin alike
    OUT/stages/<key>.checkpoint.pt  where an unfinished stage stands
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
import json
import logging
import pickle
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch

from ..errors import MethodFailed, StoreError
from .atomic import write_atomically
from .claim import claim, patient_claim
from .schema import RESULT_SCHEMA, Failure, Result

logger = logging.getLogger(__name__)

REQUIRED_KEYS = frozenset(Result.__required_keys__)


class OtherSchema(StoreError):
    """A result that another version of the code wrote."""


class Store:
    """A folder of results; it is created when first written to."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def claim(self, name: str) -> AbstractContextManager[None]:
        """Exclusive right to work on a key, until the block ends or the process dies. Raises Claimed."""
        return claim(self.folder / "locks" / name)

    def patient_claim(self, name: str) -> AbstractContextManager[None]:
        """Exclusive right to work on a key, waiting until it is free; for short work."""
        return patient_claim(self.folder / "locks" / name)

    def result(self, key: str) -> Result | None:
        """The finished result of a cell, or None; a damaged file is reported, moved aside and counts as absent."""
        path = self._cell_path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        try:
            stored = json.loads(content)
        except ValueError:
            self._set_aside(path, "it is not JSON")
            return None
        if not isinstance(stored, dict) or stored.get("key") != key:
            self._set_aside(path, "it is not a result of this cell")
            return None
        if stored.get("schema") != RESULT_SCHEMA:
            raise OtherSchema(
                f"{path} was written under another schema: {stored.get('schema')}",
                f"This version reads {RESULT_SCHEMA}.",
                "Use the version that wrote it, or another folder:  --out FOLDER",
            )
        if not stored.keys() >= REQUIRED_KEYS:
            self._set_aside(path, f"it lacks {', '.join(sorted(REQUIRED_KEYS - stored.keys()))}")
            return None
        return cast(Result, stored)

    def has_result(self, key: str) -> bool:
        """Whether a file for the cell's result exists; it is not read."""
        return self._cell_path(key).exists()

    def results(self) -> Iterator[Result]:
        """All finished results of this schema, in the order of their keys."""
        for path in sorted((self.folder / "cells").glob("*.json")):
            if path.name.endswith(".failed.json"):
                continue
            try:
                stored = self.result(path.stem)
            except OtherSchema as other:
                logger.warning("%s; it is left alone", other.what)
                continue
            if stored is not None:
                yield stored

    def put_result(self, result: Result, arrays: Mapping[str, np.ndarray]) -> None:
        """Store a finished cell: first its arrays, then the JSON, which marks it complete."""
        packed = io.BytesIO()
        np.savez_compressed(packed, allow_pickle=False, **arrays)
        write_atomically(self.arrays_path(result["key"]), packed.getvalue())
        write_atomically(self._cell_path(result["key"]), strict_json(result))
        self.drop_failure(result["key"])

    def arrays_path(self, key: str) -> Path:
        """Where the arrays of a finished cell are."""
        return self._cell_path(key).with_suffix(".npz")

    def failure(self, key: str) -> Failure | None:
        """Why the cell failed when it was last tried, or None."""
        try:
            return cast(Failure, json.loads(self._failure_path(key).read_bytes()))
        except FileNotFoundError:
            return None
        except ValueError:
            self._set_aside(self._failure_path(key), "it is not JSON")
            return None

    def put_failure(self, failure: Failure) -> None:
        """Store why a cell failed."""
        write_atomically(self._failure_path(failure["key"]), strict_json(failure))

    @contextmanager
    def keeping_tracebacks(self) -> Iterator[None]:
        """What a method raises within is raised again with the place of its traceback."""
        try:
            yield
        except MethodFailed as failure:
            raise self.with_traceback(failure) from failure

    def with_traceback(self, failure: MethodFailed) -> MethodFailed:
        """The same failure, which says where its traceback is kept: under a name of its content, so once for many."""
        if not failure.trace:
            return failure
        content = failure.trace.encode(errors="replace")
        path = self.folder / "tracebacks" / f"{hashlib.sha256(content).hexdigest()[:12]}.txt"
        with self.patient_claim(path.name):
            if not path.exists():
                write_atomically(path, content)
        remedy = f"{failure.remedy} The whole traceback: {path}".strip()
        return MethodFailed(failure.what, failure.why, remedy)

    def tensors(self, name: str, device: torch.device) -> dict[str, Any] | None:
        """What ``put_tensors`` stored under ``name``, or None; a damaged file is moved aside and counts as absent.

        Tensors saved from a GPU are loaded to ``device``; those saved from the CPU (random states) stay there.
        """
        path = self.folder / f"{name}.pt"
        try:
            with zipfile.ZipFile(path) as archive:  # torch itself does not compare the checksums
                damaged = archive.testzip()
            if damaged is None:
                return cast(dict[str, Any], torch.load(path, _placed_on(device), weights_only=True))
            reason = f"the checksum of its part {damaged} is wrong"
        except FileNotFoundError:
            return None
        except (zipfile.BadZipFile, RuntimeError, EOFError, pickle.UnpicklingError) as error:
            reason = str(error)
        self._set_aside(path, reason)
        return None

    def put_tensors(self, name: str, content: Mapping[str, Any]) -> None:
        """Store tensors and plain values under a name such as ``stages/<key>``."""
        packed = io.BytesIO()
        torch.save(dict(content), packed)
        write_atomically(self.folder / f"{name}.pt", packed.getbuffer())

    def has_tensors(self, name: str) -> bool:
        """Whether a file exists under the name; it is not read."""
        return (self.folder / f"{name}.pt").exists()

    def drop_tensors(self, name: str) -> None:
        """Remove what is stored under a name, if anything is (a checkpoint whose stage has ended)."""
        (self.folder / f"{name}.pt").unlink(missing_ok=True)

    def files(self, names: Iterable[str]) -> dict[str, bytes]:
        """Contents of the named files (paths within the store) that exist."""
        there = [name for name in names if (self.folder / name).exists()]
        return {name: (self.folder / name).read_bytes() for name in there}

    def take_over(self, files: Mapping[str, bytes]) -> None:
        """Write files of another store, in their order: a result must come after its arrays."""
        for name, content in files.items():
            write_atomically(self.folder / name, content)

    def drop_failure(self, key: str) -> None:
        """Remove the failure of a cell that has succeeded."""
        self._failure_path(key).unlink(missing_ok=True)

    def _cell_path(self, key: str) -> Path:
        return self.folder / "cells" / f"{key}.json"

    def _failure_path(self, key: str) -> Path:
        return self.folder / "cells" / f"{key}.failed.json"

    def _set_aside(self, path: Path, reason: str) -> None:
        """Move a damaged file out of the way, never over another one."""
        aside = self.folder / "aside"
        aside.mkdir(exist_ok=True)
        taken = sum(1 for other in aside.iterdir() if other.name.startswith(path.name))
        path.rename(aside / f"{path.name}.{taken}")
        logger.warning("%s is damaged (%s); it was moved to %s and will be made again", path, reason, aside)


def product_name(key: str) -> str:
    """Name of a stage's product in a store."""
    return f"stages/{key}"


def checkpoint_name(key: str) -> str:
    """Name of an unfinished stage's checkpoint in a store."""
    return f"{product_name(key)}.checkpoint"


def _placed_on(device: torch.device) -> Callable[[Any, str], Any]:
    def place(storage: Any, location: str) -> Any:
        return storage if location == "cpu" else storage.to(device)

    return place


def strict_json(content: Mapping[str, Any]) -> bytes:
    """JSON without NaN and infinity, one value per line, with the same bytes for the same content."""
    return (json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()
