"""The surfels of a model that ``train`` left in a folder, or of a row of a run, and from where they are looked at."""

from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.errors import DataError, UsageError
from radiogs_core.surfels.stored_tensors import restored_surfels
from radiogs_core.surfels.surfels import Surfels
from radiogs_reports.maps import read_maps

from ..initial_viewpoint import InitialViewpoint
from ..runs.sweep import read_sweep
from ..runs.trained_folder import product_of, read_about
from ..store.folder import Store, product_name

CPU = torch.device("cpu")


def surfels_in(folder: Path, row: str | None) -> Surfels:
    """The surfels in a folder of ``train``, or of a row of a run. Raises DataError if there are none."""
    if (folder / "trained.json").exists():
        products = [product_of(folder, read_about(folder)["training_key"], CPU)]
    else:
        refs = [ref for ref in read_sweep(folder)["cells"] if row in (None, ref["row"])]
        if not refs:
            raise UsageError(
                f"the run in '{folder}' has no row '{row}'", "", f"See them:  radiogs-bench status {folder}"
            )
        stored = (Store(folder).tensors(product_name(ref["stages"][-1]), CPU) for ref in refs if ref["stages"])
        products = [each["product"] for each in stored if each is not None][:1]
    if not products:
        raise DataError(
            f"no model is trained in '{folder}'" + (f" for the row '{row}'" if row else ""),
            "Its files would lie in stages/.",
            "Let the run go on until a cell is trained, or train one:  radiogs-bench train SCENE --out DIR",
        )
    if "surfels" not in products[0]:
        raise DataError(f"the model in '{folder}' has no surfels", "Its method keeps something else.")
    return restored_surfels(products[0]["surfels"])


def initial_viewpoint_in(folder: Path, row: str | None) -> InitialViewpoint | None:
    """The initial viewpoint of the model's scene; None if no finished cell stores one."""
    kept: dict[str, Any] = {}
    if (folder / "trained.json").exists():
        kept = read_about(folder).get("standpoint", {})
    else:
        store = Store(folder)
        for ref in read_sweep(folder)["cells"]:
            if not kept and row in (None, ref["row"]) and store.result(ref["key"]) is not None:
                arrays = read_maps(store.arrays_path(ref["key"]), "surfels/")
                names = ("eye", "up", "middle", "arc")
                kept = {name: arrays[f"surfels/{name}"] for name in names if f"surfels/{name}" in arrays}
    return InitialViewpoint(**{name: torch.tensor(value).float() for name, value in kept.items()}) if kept else None


def upwards_in(folder: Path, row: str | None) -> Float[Tensor, "3"]:
    """The upward direction of the model's scene, unit, in the world; Z where it is unknown."""
    seen_from = initial_viewpoint_in(folder, row)
    return torch.tensor([0.0, 0.0, 1.0]) if seen_from is None else seen_from.up
