"""The harness from Python: scenes, training, rendering, relighting, scoring, and stored results as data frames.

    import radiogs_bench as rb

    scene = rb.load_scene("corner")
    model = rb.train("radiogs", scene, preset="smoke")
    image = model.render(scene.test[0])["image"]
    relit = model.relight(scene.lights["sunset"], scene.test[0])["image"]
    print(model.score())

docs/python_api.md is a longer walk. Names that are not in ``radiogs_bench.__all__`` may change without notice.
"""

import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Method, Run, Trained
from radiogs_core.kernels.runtime import use_threads, workers
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import known_names, load_scene
from radiogs_datasets.lights import read_light as read_light_file

from .export.records import rows
from .methods import budget_of, method_names, variant_of
from .methods import method as installed_method
from .runs.cell import Work, cell_of
from .runs.interruption import Interruption
from .runs.preflight import read_everything
from .runs.progress import progress_for_stderr
from .runs.scene_digest import checksum_now
from .runs.stages import Bench, trained
from .runs.sweep import read_sweep
from .runs.trained_folder import read_trained, write_trained
from .scoring.evaluate import SCORES_ALONE, evaluate
from .scoring.maps import on_black
from .scoring.metrics.protocols import PROTOCOLS
from .scoring.metrics.protocols import protocol as protocol_of
from .store.claim import saying_who_holds
from .store.folder import Store

__all__ = [
    "Model",
    "load_scene",
    "method",
    "method_names",
    "open_model",
    "open_store",
    "protocol_names",
    "read_light",
    "scene_names",
    "train",
]


@dataclass(frozen=True)
class Model:
    """A trained model of any method, and what it was trained on.

    ``trained`` is the method's own object (``radiogs_core.contract.Trained``); ``facts`` what it says of itself.
    """

    trained: Trained
    run: Run

    @property
    def facts(self) -> dict[str, Any]:
        """Plain values such as ``surfels``, how many it has."""
        return self.trained.facts()

    @property
    def light(self) -> EnvironmentMap | None:
        """The recovered light, linear radiance (latitude-longitude, Z up, centre column +X); None if there is none."""
        return self.trained.light

    def render(self, view: View, *further: str) -> dict[str, Tensor]:
        """Maps of a view's camera, [height, width, channels], on black and on the CPU.

        ``image`` is display sRGB in [0, 1]; what else there is depends on the method (``contract.Prepared.offers``).
        """
        return _maps(self.trained.prepare(), view, self.run.device, further)

    def relight(
        self, light: EnvironmentMap, view: View, albedo_scale: Float[Tensor, "3"] | None = None
    ) -> dict[str, Tensor]:
        """Maps of a view's camera under another light. Raises NotOffered where the method cannot be relit."""
        return _maps(self.trained.prepare(light, albedo_scale), view, self.run.device, ())

    def score(self, protocol: str = "default") -> pd.DataFrame:
        """Metrics of the scene's test views and relightings: a line a metric (``task/measure``).

        Columns: ``value``, the mean; ``reason``, why there is none; and the value of each view under its name.
        """
        result = evaluate(
            self.trained,
            self.run.scene,
            protocol_of(protocol),
            self.run.device,
            lambda done, total: None,
            scope=SCORES_ALONE,
        )
        lines = {
            name: {
                "value": each["value"],
                "reason": each["reason"],
                **dict(zip(result.views, each["views"], strict=True)),
            }
            for name, each in result.metrics.items()
        }
        return pd.DataFrame.from_dict(lines, orient="index").rename_axis("metric")


def scene_names() -> tuple[str, ...]:
    """Names of the scenes that come with the package; ``load_scene`` takes them, and folders."""
    return known_names()


def protocol_names() -> tuple[str, ...]:
    """Names of the metric protocols (docs/protocols.md)."""
    return tuple(PROTOCOLS)


def method(name: str) -> Method:
    """An installed method by its name, or one from a TOML file of commands. Raises UsageError."""
    return installed_method(name)


def read_light(path: str | Path) -> EnvironmentMap:
    """The light in an .exr or .hdr file: linear radiance, latitude-longitude, Z up, centre column towards +X.

    Negative radiance becomes zero, with a warning. Raises UsageError for a file of another kind, DataError for a
    damaged one, for one of fewer than three channels, and for one without light.
    """
    light, repairs = read_light_file(Path(path))
    for repair in repairs:
        warnings.warn(repair, stacklevel=2)
    return light


def train(
    method: str | Method,
    scene: str | Scene,
    preset: str = "tiny",
    variant: Mapping[str, Any] | None = None,
    seed: int = 0,
    device: str = "cpu",
    out: str | Path | None = None,
) -> Model:
    """Train a method on a scene, or continue, and return the model.

    ``variant`` holds the fields in which the method differs from its full form, as plain values. What is kept in
    ``out`` (default: nothing) is what ``radiogs-bench train`` keeps: a run that was stopped continues there, a finished
    one is read. Raises UsageError, DataError, NumericalFailure, and Interrupted after Ctrl-C.
    """
    used = installed_method(method) if isinstance(method, str) else method
    read = load_scene(scene) if isinstance(scene, str) else scene
    use_threads(workers(torch.device("cpu")))  # as many as chosen before, else as PyTorch has
    work = Work(variant_of(used, variant or {}), budget_of(used, preset), seed, device)
    cell = cell_of(used, read, work, method if isinstance(method, str) else "")
    with tempfile.TemporaryDirectory(prefix="radiogs-bench-") as kept_nowhere:
        store = Store(Path(kept_nowhere if out is None else out))
        with saying_who_holds(str(out)), progress_for_stderr() as progress, Interruption() as interruption:
            read_everything(read, lambda done, total: progress.advance(f"reading {read.name}", done, total))
            bench = Bench(store, torch.device(device), progress, interruption, lambda name: used, checksum_now)
            model, _ = trained(bench, cell, read)
        if out is not None:
            write_trained(store, str(read.folder or read.name), read, cell, model)
    return Model(model, Run(read, cell.variant, cell.budget, seed, torch.device(device)))


def open_model(folder: str | Path, device: str = "cpu", **turned: Any) -> Model:
    """The model that ``train`` left in a folder.

    ``turned`` are fields of the variant that showing alone reads, such as RadioGS's ``relighting="surfels"``. Raises
    DataError where there is none or its scene has changed.
    """
    run, model = read_trained(Path(folder), torch.device(device), turned)
    return Model(model, run)


def open_store(folder: str | Path) -> pd.DataFrame:
    """Every metric of every finished cell of a folder of results: a line a cell and metric.

    Columns: ``row`` (of the folder's last run; None for a cell of another one), scene, method, variant fields, budget,
    seed, device, protocol, metric, value, reason, seconds by stage, counters of work and guards, surfels, key. Raises
    DataError where nothing was run.
    """
    place = Path(folder)
    named = {cell["key"]: cell["row"] for cell in read_sweep(place)["cells"]}
    table = pd.DataFrame(list(rows(Store(place))))
    table.insert(0, "row", [named.get(key) for key in table["key"]] if len(table) else [])
    return table


def _maps(prepared: Any, view: View, device: torch.device, further: tuple[str, ...]) -> dict[str, Tensor]:
    return on_black(prepared, view.camera.to(device, torch.float32), *further)
