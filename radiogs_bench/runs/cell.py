"""Cells: the unit of running, storing and resuming, with keys over everything that affects a result."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from radiogs_core.contract import Method, SharedStart, StageSpec
from radiogs_core.plain_values import to_plain
from radiogs_core.scene.scene import Scene

from ..method_calls import calling
from ..scoring.metrics.weights import FILES, missing_weights
from ..sources import code_digest
from ..store.keys import content_key
from ..suites.experiment import EXPERIMENTS, TRAINING, Experiment


@dataclass(frozen=True)
class StageKey:
    """A stage of a cell: name, title, steps, key of its product, and of its start if that is shared."""

    name: str
    title: str
    steps: int
    key: str
    start: str | None = None


@dataclass(frozen=True)
class Work:
    """The settings of a cell that do not depend on its scene or method."""

    variant: Any
    budget: Any
    seed: int = 0
    device: str = "cpu"
    protocol: str = "default"
    experiment: str = TRAINING
    settings: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Cell(Work):
    """One training and its evaluation: scene x method x variant x budget x seed, scored under a protocol.

    ``checksum`` digests the scene's files, ``loader`` the sources that read them, ``method_code`` those of the method
    and ``evaluation_code`` those that score it (see ``sources``). ``device`` is "cpu" or "cuda", because seconds and
    last digits differ between them. The suite is not part of a cell: two suites that share a row share its result.
    ``experiment`` is the kind of work (see ``experiment``), ``settings`` belong to that experiment.

    Each stage's key covers exactly what its product depends on, so that cells share stages; ``key`` names the scored
    result. ``found_as`` is the argument of ``methods.method``: the method's name, or the path of its TOML file, which
    is not part of the key. Make cells with ``cell_of``.
    """

    scene: str
    checksum: str
    loader: str
    method: str
    stages: tuple[StageKey, ...]
    method_code: str
    evaluation_code: str
    found_as: str = ""

    @property
    def training_key(self) -> str | None:
        """Key of the trained model, which is the last stage's key; None for an experiment without training."""
        return self.stages[-1].key if self.stages else None

    @property
    def first_key(self) -> str:
        """Key of the first stage, which cells may share; the key of the cell if it has no stages."""
        return self.stages[0].key if self.stages else self.key

    @cached_property
    def key(self) -> str:
        """Key of the scored result."""
        return content_key(self.content())

    def content(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values; the checksum is for the scene, wherever it lies."""
        return {
            "checksum": self.checksum,
            "loader": self.loader,
            "method": self.method,
            "variant": to_plain(self.variant),
            "budget": to_plain(self.budget),
            "seed": self.seed,
            "device": self.device,
            "protocol": self.protocol,
            "stages": {stage.name: stage.key for stage in self.stages},
            "method_code": self.method_code,
            "evaluation_code": self.evaluation_code,
            "experiment": self.experiment,
            "settings": dict(self.settings),
        }


def cell_of(method: Method, scene: Scene, work: Work, found_as: str = "") -> Cell:
    """The cell of a method, a scene and settings. Each stage's key is over its own dependencies and the key before it.

    ``found_as``: the path of the method's TOML file, if it has one.
    """
    kind = EXPERIMENTS[work.experiment]
    loader = code_digest(*scene.loaders, *(scene.surfaces_by if kind.on_surfaces else ()))
    evaluation = evaluation_code(kind, method)
    with calling(method.name, "stages()"):
        specs = method.stages(work.variant, work.budget) if kind.trains else ()
    begin = {"checksum": scene.checksum, "loader": loader, "seed": work.seed, "device": work.device}
    stages: list[StageKey] = []
    for spec in specs:
        before = stages[-1].key if stages else None
        with calling(method.name, f"the reads and sources of stage '{spec.name}'"):
            start = None
            if spec.start is not None:
                depends = {**begin, "before": before, "owner": spec.owner, "start of": spec.name}
                before = start = content_key(depends | _read_by(spec.start, scene))
            depends = {**begin, "before": before, "owner": spec.owner, "stage": spec.name} | _read_by(spec, scene)
        if kind.scores_on_the_way and spec is specs[-1]:  # then the scores are a part of what the stage leaves
            depends |= {"experiment": work.experiment, "protocol": work.protocol, "evaluation_code": evaluation}
        stages.append(StageKey(spec.name, spec.title, spec.steps, content_key(depends), start))
    sources = {source for spec in specs for source in spec.sources}
    return Cell(
        **vars(work),
        scene=scene.name,
        checksum=scene.checksum,
        loader=loader,
        method=method.name,
        stages=tuple(stages),
        method_code=code_digest(*sources, *method.sources) if specs else "",
        evaluation_code=evaluation,
        found_as=found_as or method.name,
    )


def _read_by(spec: StageSpec | SharedStart, scene: Scene) -> dict[str, Any]:
    """Fields of settings and digests of sources that a stage, or its start, depends on besides its input."""
    read = {"reads": json.loads(json.dumps(spec.reads, allow_nan=False)), "code": code_digest(*spec.sources)}
    return read | ({"surfaces": code_digest(*scene.surfaces_by)} if spec.uses_surfaces else {})


def evaluation_code(experiment: Experiment, method: Method | None = None) -> str:
    """Digest of the sources that turn a model or files into metrics; it names LPIPS networks without weights."""
    shown_by = method.sources if experiment.trains and method is not None else ()
    digest = code_digest(*experiment.sources, *shown_by)
    missing = [net for net in FILES if missing_weights(net)]
    return f"{digest} without LPIPS weights of {', '.join(missing)}" if missing else digest
