"""The harness from Python: scenes, training, rendering, relighting, scoring, and stored results as data frames.

    import radiogs_bench as rb

    scene = rb.load_scene("corner")
    model = rb.train("radiogs", scene, preset="smoke")
    image = model.render(scene.test[0])["image"]
    relit = model.relight(scene.lights["sunset"], scene.test[0])["image"]
    print(model.score())

docs/start.md is a longer walk. Names that are not in ``radiogs_bench.__all__`` may change without notice.
"""

import json
import math
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict, Unpack

import cv2
import numpy as np
import pandas as pd
import torch
from jaxtyping import Float
from torch import Tensor

from radiogs_core.contract import Method, Prepared, Run, Trained
from radiogs_core.errors import unknown
from radiogs_core.kernels.runtime import use_threads, workers
from radiogs_core.plain_values import flat
from radiogs_core.scene.lamps import Lamp
from radiogs_core.scene.light import EnvironmentMap
from radiogs_core.scene.placed_light import placed_light
from radiogs_core.scene.scene import Scene, View
from radiogs_datasets import known_names, load_scene
from radiogs_datasets.lights import latitude_longitude, read_lamps
from radiogs_datasets.lights import read_light as read_light_file
from radiogs_datasets.options import AS_STORED, SceneOptions
from radiogs_datasets.soundness import require_trainable

from .device import device_named
from .export.records import rows
from .export.views import lit_by_lamps
from .initial_viewpoint import upwards
from .installed_methods import method_names
from .methods import budget_of, splat_fields, variant_by_recipe
from .methods import method as installed_method
from .runs.cell import Cell, Work, cell_of
from .runs.interruption import Interruption
from .runs.preflight import read_everything, say_contradictions
from .runs.progress import progress_for_stderr
from .runs.scene_checksum import checksum_now
from .runs.stages import Bench, facts_of, trained
from .runs.stored_progress import KeptPace
from .runs.sweep import read_sweep
from .runs.trained_folder import Origin, read_about, read_trained, set_other_model_aside, write_trained
from .scoring.evaluate import SCORES_ALONE, evaluate
from .scoring.metrics.protocols import PROTOCOLS
from .scoring.metrics.protocols import protocol as protocol_of
from .scoring.rendering import on_black
from .store.claim import saying_who_holds
from .store.folder import Store
from .trusted_methods import trusting

__all__ = [
    "Model",
    "PreparedModel",
    "load_scene",
    "method",
    "method_names",
    "open_model",
    "open_store",
    "protocol_names",
    "read_lamps",
    "read_light",
    "scene_names",
    "train",
]


@dataclass(frozen=True)
class PreparedModel:
    """A model made ready for many views, under its own light or another one; ``Model.prepared`` makes it."""

    prepared: Prepared
    """The method's own object (``radiogs_core.contract.Prepared``)."""
    run: Run
    """Scene, variant, budget, seed and device of the model."""

    def render(self, view: View | str, *further: str) -> dict[str, Tensor]:
        """Maps of a view's camera, as ``Model.render`` gives them."""
        camera = _view(self.run.scene, view).camera.to(self.run.device, torch.float32)
        return on_black(self.prepared, camera, *further)

    def __repr__(self) -> str:
        return f"PreparedModel(scene {self.run.scene.name!r}, maps {', '.join(self.prepared.offers)})"


@dataclass(frozen=True, repr=False)
class Model:
    """A trained model of any method, and what it was trained on."""

    trained: Trained
    """The method's own object (``radiogs_core.contract.Trained``)."""
    run: Run
    """Scene, variant, budget, seed and device."""
    method: str
    """The method's name."""
    seconds: float | None = None
    """Seconds that all stages of training took; None for a model that ``open_model`` has read."""
    files: tuple[Path, ...] = ()
    """The files that ``train`` wrote for other programs, and ``trained.json``."""

    @property
    def facts(self) -> dict[str, Any]:
        """The method's facts about its model: plain values such as ``surfels``, their number."""
        return facts_of(self.method, self.trained)

    @property
    def light(self) -> EnvironmentMap | None:
        """The recovered light, linear radiance (latitude-longitude, Z up, centre column +X); None without one."""
        return self.trained.light

    def __repr__(self) -> str:
        run = self.run
        return f"Model({self.method!r}, scene {run.scene.name!r}, preset {run.budget.name!r}, seed {run.seed})"

    def _repr_png_(self) -> bytes:
        """The first test view, which a notebook shows where the model is a cell's last value."""
        image = self.render(self.run.scene.test[0])["image"].numpy()
        levels = np.rint(image.clip(0, 1) * 255).astype(np.uint8)
        return cv2.imencode(".png", levels[..., ::-1])[1].tobytes()

    def prepared(
        self,
        light: EnvironmentMap | str | None = None,
        albedo_scale: Float[Tensor, "3"] | None = None,
        lamps: Sequence[Lamp] = (),
    ) -> PreparedModel:
        """The model made ready once for many views: under its own light, or under another one, also by its name.

        ``albedo_scale``: a factor of albedo by channel. ``lamps`` (``read_lamps``, ``radiogs_core.scene.lamps``): shine
        in place of its own light, and beside another one. Raises NotOffered where the method cannot be relit,
        UsageError for a light that the scene does not have, and for lamps where the method takes none.
        """
        found = None if light is None else _light(self.run.scene, light)
        if lamps:
            return PreparedModel(lit_by_lamps(self.method, self.trained, lamps, found, albedo_scale), self.run)
        ready = self.trained.prepare() if found is None else self.trained.prepare(found, albedo_scale)
        return PreparedModel(ready, self.run)

    def placed(
        self, light: EnvironmentMap, up: Float[Tensor, "3"] | None = None, turn: float = 0.0, strength: float = 1.0
    ) -> EnvironmentMap:
        """Turn a light with Z up into the world of this model's scene, and multiply it by ``strength``.

        ``up``: upward direction of that world (default: the cameras' upward direction, or Z if the scene has lights of
        its own). ``turn``: degrees about up, counter-clockwise seen from above.
        """
        return placed_light(light, upwards(self.run.scene) if up is None else up, turn, strength)[0]

    def render(self, view: View | str, *further: str) -> dict[str, Tensor]:
        """Maps of a view's camera, [height, width, channels], on black and on the CPU.

        ``view``: a view of any scene, or the name of one of this scene. ``image`` is display sRGB in [0, 1]; what else
        there is depends on the method (``contract.Prepared.offers``). Raises UsageError for an unknown name.
        """
        return self.prepared().render(view, *further)

    def relight(
        self, light: EnvironmentMap | str, view: View | str, albedo_scale: Float[Tensor, "3"] | None = None
    ) -> dict[str, Tensor]:
        """Maps of a view's camera under another light; both also by their names in the scene.

        Raises NotOffered where the method cannot be relit, UsageError for an unknown name. For many views under one
        light: ``prepared``.
        """
        return self.prepared(light, albedo_scale).render(view)

    def score(self, protocol: str = "default") -> pd.DataFrame:
        """Metrics of the scene's test views and relightings: one line per metric (``task/measure``).

        Columns: ``value``, the mean; ``reason``, why it is missing; and the value of each view under its name.
        """
        scene, rules = self.run.scene, protocol_of(protocol)
        result = evaluate(self.trained, scene, rules, self.run.device, lambda done, total: None, SCORES_ALONE)
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
    with trusting([name]):
        return installed_method(name)


def read_light(path: str | Path) -> EnvironmentMap:
    """The light in an .exr or .hdr file: linear radiance, latitude-longitude, Z up, centre column towards +X.

    Negative radiance becomes zero, and a cube map whose header gives the layout of its faces is converted, with a
    warning. Raises UsageError for a file of another kind, DataError for a damaged one, for one of fewer than three
    channels, for one without light, and for one in another shape (such as an angular map).
    """
    light, repairs = read_light_file(Path(path))
    for repair in repairs:
        warnings.warn(repair, stacklevel=2)
    return light


class TrainingOptions(TypedDict, total=False):
    """Further options of ``train``, by keyword."""

    budget: Mapping[str, Any]
    """Values that replace numbers of the preset: plain values by dotted names or in nested tables."""
    recipe: str
    """Name of the method's recipe that ``variant`` changes (default: its defaults)."""
    scene_options: SceneOptions
    """How a scene that is given by its name or folder is opened (layout, reduction, held-out views)."""
    replace: bool
    """Whether another model in ``out`` is moved aside. Without it, ``train`` raises UsageError there."""
    start: str | Path | None
    """A .ply file of splats that training starts from, in the scene's world (docs/datasets.md)."""
    say: Callable[[str], None]
    """Receives the messages of a training: what was repaired in files, and which views contradict the others.
    Default: none are shown."""


def train(
    method: str | Method,
    scene: str | Path | Scene,
    preset: str = "tiny",
    variant: Mapping[str, Any] | None = None,
    seed: int = 0,
    device: str = "cpu",
    out: str | Path | None = None,
    **options: Unpack[TrainingOptions],
) -> Model:
    """Train a method on a scene, or continue, and return the model.

    ``variant`` holds the fields in which the method differs from its full form, as plain values, by dotted names
    (``"materials.rates.light"``) or in nested tables. ``out`` keeps what
    ``radiogs-bench train`` keeps (default: nothing is kept): a training that was stopped continues there, and a
    finished model is read. ``options``: see ``TrainingOptions``. Raises UsageError, DataError, NumericalFailure, and
    Interrupted after Ctrl-C.
    """
    for name in options.keys() - TrainingOptions.__annotations__.keys():
        raise unknown("option", name, TrainingOptions.__annotations__, of="train()")
    say = options.get("say", lambda line: None)
    with trusting([method] if isinstance(method, str) else ()):
        used = installed_method(method) if isinstance(method, str) else method
    opened, on = options.get("scene_options", AS_STORED), device_named(device)
    read = scene if isinstance(scene, Scene) else load_scene(str(scene), options=opened)
    for repair in read.repairs:
        say(f"{read.name}: {repair}")
    changes, start = options.get("budget", {}), options.get("start")
    fields = {**flat(variant or {}), **({} if start is None else splat_fields(used, Path(start)))}
    made = variant_by_recipe(used, options.get("recipe", ""), read.layout, read.name, fields)
    work = Work(made, budget_of(used, preset, changes), seed, device)
    cell = cell_of(used, read, work, method if isinstance(method, str) else "")
    run = Run(read, cell.variant, cell.budget, seed, on)
    if out is None:
        with tempfile.TemporaryDirectory(prefix="radiogs-bench-") as nowhere:
            return _trained(Store(Path(nowhere)), cell, run, used, say)
    store = Store(Path(out))
    replaced = set_other_model_aside(store.folder, cell, options.get("replace", False))
    if replaced is not None:
        say(f"the files of the model that was here are in {replaced}")
    with store.keeping_tracebacks():
        name = str(read.folder or read.name) if isinstance(scene, Scene) else str(scene)
        return _trained(store, cell, run, used, say, Origin(name, preset, changes))


def _trained(
    store: Store, cell: Cell, run: Run, method: Method, say: Callable[[str], None], origin: Origin | None = None
) -> Model:
    """The cell's model, trained in a store or read from it; its files are written there if it has an ``origin``."""
    use_threads(workers(torch.device("cpu")))  # as many as chosen before, else as PyTorch has
    scene = run.scene
    with saying_who_holds(str(store.folder)), progress_for_stderr() as progress, Interruption() as interruption:
        require_trainable(scene)
        read_everything(scene, lambda done, total: progress.advance(f"reading {scene.name}", done, total))
        say_contradictions(scene, say)
        with KeptPace(progress, store, cell.key) as kept:
            bench = Bench(store, run.device, kept, interruption, lambda name: method, checksum_now)
            model, ledgers = trained(bench, cell, scene)
        files = () if origin is None else tuple(write_trained(store, origin, scene, cell, model))
    return Model(model, run, method.name, math.fsum(ledger["seconds"] for ledger in ledgers.values()), files)


def open_model(folder: str | Path, device: str = "cpu", trust: str | Path = "", **changes: Any) -> Model:
    """The model that ``train`` left in a folder.

    ``trust``: the method's TOML file, if its commands may run. ``changes`` are fields of the variant that showing alone
    reads, such as RadioGS's ``relighting="surfels"``. Raises DataError if it is missing or its scene has changed,
    UsageError if the folder names an untrusted method's file.
    """
    with trusting([str(trust)]):
        run, model = read_trained(Path(folder), device_named(device), changes)
        return Model(model, run, installed_method(read_about(Path(folder))["method"]).name)


def open_store(folder: str | Path, settings: bool = False, by_view: bool = False) -> pd.DataFrame:
    """Every metric of every finished cell in a folder of results: one line per cell and metric.

    Columns: ``row`` (None for a cell that is not part of the folder's last run), scene, method, settings (every field
    of the variant, as JSON), budget, seed, device, protocol, surfels, seconds by stage, counters of work and guards,
    key, metric, value, reason. ``settings``: each field of the variant has a column of its own. ``by_view``: a line for
    each test view instead of the mean, with the column ``view``. Raises DataError if the folder holds no run.
    """
    read_sweep(Path(folder))
    lines = list(rows(Store(Path(folder)), by_view))
    table = pd.DataFrame(lines)
    fields = [name for name in table if name.startswith("variant.")]
    if settings or not fields:
        return table
    folded = [
        json.dumps({name.removeprefix("variant."): line[name] for name in fields if name in line}) for line in lines
    ]
    place = table.columns.get_loc(fields[0])
    table = table.drop(columns=fields)
    table.insert(place, "settings", folded)
    return table


def _view(scene: Scene, view: View | str) -> View:
    if not isinstance(view, str):
        return view
    named = {each.name: each for each in (*scene.train, *scene.relight, *scene.test)}
    if view not in named:
        raise unknown("view", view, named)
    return named[view]


def _light(scene: Scene, light: EnvironmentMap | str) -> EnvironmentMap:
    """The light itself, or the scene's light of that name. Raises DataError unless the map is latitude-longitude."""
    if not isinstance(light, str):
        latitude_longitude("the light", light.radiance)
        return light
    if light not in scene.lights:
        raise unknown("light", light, scene.lights)
    return scene.lights[light]
