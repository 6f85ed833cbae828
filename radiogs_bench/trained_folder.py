"""The folder that ``train`` makes: the store of a single cell, what it was trained on, and the model as files.

``trained.json`` (schema below) names the scene, the budget and the key of the model in the store; ``surfels.ply`` (see
``radiogs_core.surfels.ply``) and ``environment.exr`` (linear radiance, lat-long, Z up, centre column towards +X) are
for other programs.
"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypedDict, cast

import torch

from radiogs.model import Model
from radiogs.variant import Variant
from radiogs_core.errors import DataError
from radiogs_core.plain import from_plain
from radiogs_core.surfels.ply import write_ply
from radiogs_datasets.image_files import write_exr

from .cell import Cell
from .store.atomic import write_atomically
from .store.folder import Store, strict_json

TRAINED_SCHEMA = "radiogs-bench/trained/1"


class Trained(TypedDict):
    """What ``trained.json`` says."""

    schema: str
    scene: str
    """As it was given: a name, or a path from where ``train`` was called."""
    checksum: str
    """Of the scene's files when it was trained on."""
    preset: str
    seed: int
    variant: dict[str, Any]
    training_key: str
    surfels: int


def write_trained(store: Store, scene: str, cell: Cell, model: Model) -> list[Path]:
    """Write what the model is and the model itself; returns the files written."""
    folder = store.folder
    about = Trained(
        schema=TRAINED_SCHEMA,
        scene=scene,
        checksum=cell.checksum,
        preset=cell.budget.name,
        seed=cell.seed,
        variant=asdict(cell.variant),
        training_key=cell.training_key,
        surfels=len(model.surfels),
    )
    written = [folder / name for name in ("surfels.ply", "environment.exr", "trained.json")]
    write_ply(model.surfels, written[0])
    write_exr(written[1], model.environment.detach().cpu().numpy())
    write_atomically(written[2], strict_json({**about}))
    return written


def variant_of(fields: dict[str, Any]) -> Variant:
    """A variant from its fields as JSON has them."""
    return from_plain(Variant, fields)


def read_trained(folder: Path, device: torch.device) -> tuple[Trained, Model]:
    """What was trained in a folder, and the model. Raises DataError where there is none."""
    path = folder / "trained.json"
    try:
        about = cast(Trained, json.loads(path.read_bytes()))
    except FileNotFoundError:
        raise DataError(
            f"nothing was trained in '{folder}'",
            f"It has no {path.name}.",
            f"Train a model there:  radiogs-bench train SCENE --out {folder}",
        ) from None
    except ValueError as error:
        raise DataError(
            f"{path} is damaged: {error}", "", "Run the same `train` again: it writes the file anew."
        ) from error
    if about.get("schema") != TRAINED_SCHEMA:
        raise DataError(
            f"{path} has schema {about.get('schema')}", f"This version reads {TRAINED_SCHEMA}.", "Train anew."
        )
    stored = Store(folder).tensors(f"trained/{about['training_key']}", device)
    if stored is None:
        raise DataError(f"the model of '{folder}' is gone", "Its file in trained/ is missing.", "Train it again.")
    return about, Model.of(stored["product"])
