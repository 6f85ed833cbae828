"""Files of tensors: torch's zip archives, with the name that they were stored under inside."""

import io
import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from .opening import explained_reading, opened
from .seal import Broken

STORED_AS = "stored_as"

FOLDER = 0x10
"""Attribute bit of a folder's entry: torch would read no data for it and leave memory uninitialised."""


def packed(name: str, content: Mapping[str, Any]) -> memoryview:
    """The bytes of a file of tensors and plain values that is stored under ``name``."""
    file = io.BytesIO()
    torch.save({STORED_AS: name, "content": dict(content)}, file)
    return file.getbuffer()


def read_tensors(path: Path, name: str, device: torch.device) -> dict[str, Any]:
    """Reads the content that was stored under ``name``. Pickles are not executed; every part's checksum is compared.

    Tensors saved from a GPU are loaded to ``device``; those saved from the CPU (random states) stay there. Raises
    FileNotFoundError, StoreError where the file cannot be read, DataError where it is no regular file, and Broken if it
    is damaged or stored under another name.
    """

    def placed(storage: Any, origin: str) -> Any:
        return storage if origin == "cpu" else storage.to(device)

    try:
        with explained_reading(path):
            with opened(path) as file, zipfile.ZipFile(file) as archive:  # torch itself does not compare the checksums
                if any(part.compress_type or part.external_attr & FOLDER for part in archive.infolist()):
                    raise Broken("a part of it is compressed or marked as a folder, which torch never does")
                damaged = archive.testzip()
            if damaged is not None:
                raise Broken(f"the checksum of its part {damaged} is wrong")
            stored = torch.load(path, placed, weights_only=True)
    except (zipfile.BadZipFile, pickle.UnpicklingError, RuntimeError, EOFError, ValueError, KeyError) as error:
        raise Broken(f"{error}".strip().partition("\n")[0] or type(error).__name__) from error
    if not isinstance(stored, dict) or not isinstance(stored.get("content"), dict):
        raise Broken("it does not say what it was stored as")
    if stored.get(STORED_AS) != name:
        raise Broken(f"it was stored as {stored.get(STORED_AS)!r:.80}, not as '{name}'")
    return dict(stored["content"])
