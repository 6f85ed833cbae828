"""The folder that ``train`` makes: a store of a single cell, and the model as files.

``trained.json`` (schema below) names the method, scene, budget and the key of the model in the store. Further files
are for other programs: what the method exports (RadioGS: ``surfels.ply``, see ``radiogs_core.surfels.ply``)
and the recovered light as ``environment.exr`` (linear radiance, lat-long, Z up, centre column towards +X).
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NotRequired, TypedDict, cast

import torch

from radiogs_core.contract import Run, Trained
from radiogs_core.errors import DataError, UsageError
from radiogs_core.own_files import fresh, own_folder
from radiogs_core.plain_values import flat, to_plain, with_values
from radiogs_core.scene.scene import Scene
from radiogs_datasets import load_scene
from radiogs_datasets.image_files import write_exr
from radiogs_datasets.options import options_of
from radiogs_datasets.registry import scene_folder

from ..initial_viewpoint import initial_viewpoint
from ..method_calls import calling
from ..methods import budget_of, marks_of, method, variant_of
from ..store.atomic import explained
from ..store.folder import FOLDERS, Store, product_name
from ..store.keys import plain_name
from ..store.seal import Broken, OtherSchema, read_sealed, write_sealed
from ..suites.scenes import place_of
from .cell import Cell
from .stages import facts_of, restored
from .sweep import preset_text

TRAINED_SCHEMA = "radiogs-bench/trained/3"


@dataclass(frozen=True)
class Origin:
    """The names by which a model's scene and budget are found again."""

    scene: str
    """The scene's name or folder."""
    preset: str
    budget: Mapping[str, Any]
    """Values that replace numbers of the preset, by dotted names."""


class About(TypedDict):
    """Contents of ``trained.json``."""

    schema: str
    method: str
    """The method's name, or the path of its TOML file."""
    scene: str
    """Name of a scene of the package, or the absolute path of the scene's folder."""
    given: NotRequired[str]
    """The name given to ``train``, to find a moved folder in data roots and working folders."""
    options: NotRequired[dict[str, Any]]
    """The options that the scene was opened with (``SceneOptions.plain``); absent for a scene as it is stored."""
    checksum: str
    """Checksum of the scene's files at training."""
    preset: str
    budget: NotRequired[dict[str, Any]]
    """Numbers that were set in place of the preset's, by dotted names; absent where none were."""
    seed: int
    variant: dict[str, Any]
    training_key: str
    facts: dict[str, Any]
    """The method's facts about its model."""
    standpoint: NotRequired[dict[str, list[float]]]
    """From where it is looked at first (``radiogs_bench.initial_viewpoint``)."""
    seal: NotRequired[str]
    """Added when it is written (``store.seal``)."""


def write_trained(store: Store, origin: Origin, scene: Scene, cell: Cell, model: Trained) -> list[Path]:
    """Write ``trained.json`` and the model's files; returns their paths."""
    folder = store.folder
    assert cell.training_key is not None
    about = About(
        schema=TRAINED_SCHEMA,
        method=cell.found_as,
        scene=place_of(origin.scene),
        checksum=cell.checksum,
        preset=origin.preset,
        seed=cell.seed,
        variant=to_plain(cell.variant),
        training_key=cell.training_key,
        facts=facts_of(cell.method, model),
        standpoint=initial_viewpoint(scene, scene.train[0].camera).plain(),
    )
    given, masks = Path(origin.scene), Path(scene.options.get("mask_folder", ""))
    if given.name and ".." not in given.parts:
        about["given"] = origin.scene
    if scene.options:
        about["options"] = dict(scene.options)
    if masks.is_relative_to(about["scene"]):  # the folder may be moved with its masks
        about["options"]["mask_folder"] = str(masks.relative_to(about["scene"]))
    if origin.budget:
        about["budget"] = flat(origin.budget)
    written = _exported(cell.method, model, folder)
    with calling(cell.method, "light"):
        light = model.light
    if light is not None:
        written.append(folder / "environment.exr")
        write_exr(written[-1], light.radiance.numpy())
    write_sealed(folder / "trained.json", about)
    return [*written, folder / "trained.json"]


def _exported(method_name: str, model: Trained, folder: Path) -> list[Path]:
    """The model's files: the method writes them into a new folder, without links; then they are moved into place."""
    with explained(folder), TemporaryDirectory(prefix=".export-", dir=folder) as new:
        with calling(method_name, "export()"):
            listed = [Path(path) for path in model.export(Path(new))]
        for path in sorted(Path(new).rglob("*")):
            if not path.is_dir():
                path.replace(fresh(folder / path.relative_to(new), folder))
        return [folder / path.relative_to(new) if path.is_relative_to(new) else path for path in listed]


def read_about(folder: Path) -> About:
    """Read ``trained.json``. Raises DataError if it is missing, damaged, or of another version."""
    path = folder / "trained.json"
    try:
        about = cast(About, read_sealed(path, TRAINED_SCHEMA, About.__required_keys__, About))
    except FileNotFoundError:
        raise DataError(
            f"nothing was trained in '{folder}'",
            f"It has no {path.name}.",
            f"Train a model there:  radiogs-bench train SCENE --out {folder}",
        ) from None
    except (Broken, OtherSchema) as error:
        raise DataError(
            f"{path} is damaged: {error}" if isinstance(error, Broken) else error.what,
            "It says which model is here, and of what.",
            "Run the same `train` again: it writes the file anew and repeats no finished stage.",
        ) from error
    plain_name(about["training_key"], f"the key of the model in {path}")
    return about


def set_other_model_aside(folder: Path, cell: Cell, replace: bool) -> Path | None:
    """Move the files of another model aside if ``replace`` allows it; returns where they are. Raises UsageError."""
    try:
        about = read_about(folder)
    except DataError:
        return None
    if about["training_key"] == cell.training_key:
        return None
    if not replace:
        preset = preset_text(about["preset"], marks_of(about.get("budget", {})))
        raise UsageError(
            f"{folder} holds another trained model: {about['method']} of scene '{about['scene']}', preset {preset},"
            f" seed {about['seed']}",
            "It was trained from another scene, with other settings, or by another version of the code.",
            "Give another --out, or --force: its files are then moved to a folder beside the new ones.",
        )
    kept = own_folder(folder / f"replaced-{about['training_key']}", folder)
    for path in sorted(folder.iterdir()):
        if path.name not in FOLDERS and not path.name.startswith("replaced-"):
            os.replace(path, kept / path.name)
    return kept


def read_trained(folder: Path, device: torch.device, changes: Mapping[str, Any] | None = None) -> tuple[Run, Trained]:
    """The run and the model that were trained in a folder.

    ``changes``: new values of variant fields that only rendering reads, such as RadioGS's ``relighting``. Raises
    DataError if there is no model or its scene has changed.
    """
    about = read_about(folder)
    used = method(about["method"])
    variant = with_values(variant_of(used, about["variant"]), changes or {}, f"variant of {used.name}")
    named = about["scene"] if Path(about["scene"]).is_dir() else about.get("given", about["scene"])
    options = dict(about.get("options", {}))
    if "mask_folder" in options:
        options["mask_folder"] = str(scene_folder(named) / str(options["mask_folder"]))
    scene = load_scene(named, options=options_of(options))
    if scene.checksum != about["checksum"]:
        raise DataError(
            f"scene '{named}' has changed since the model was trained",
            "Its files have another checksum.",
            "Put the old files back, or train again.",
        )
    workspace = Store(folder).workspace(about["training_key"])
    budget = budget_of(used, about["preset"], about.get("budget"))
    run = Run(scene, variant, budget, about["seed"], device, workspace)
    return run, restored(used, run, product_of(folder, about["training_key"], device))


def product_of(folder: Path, key: str, device: torch.device) -> dict[str, Any]:
    """The stored product of a stage. Raises DataError if its file is missing."""
    stored = Store(folder).tensors(product_name(key), device)
    if stored is None:
        raise DataError(f"the model of '{folder}' is gone", "Its file in stages/ is missing.", "Train it again.")
    return cast(dict[str, Any], stored["product"])
