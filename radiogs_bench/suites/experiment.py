"""Experiments as data: the work done for a cell, and the sources that decide what is measured."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pkgutil import resolve_name

EVALUATION = ("radiogs_bench.scoring.evaluate", "radiogs_bench.scoring.what_images_determine")


@dataclass(frozen=True)
class Experiment:
    """A kind of work on a cell."""

    name: str
    function: str | None = None
    """``module:name`` of the function that runs a cell and stores its result, given a bench, the cell and its scene.

    A name, because suites are data: they import nothing that runs. None for work outside suites.
    """
    trains: bool = True
    """Whether the method is trained."""
    scores_on_the_way: bool = False
    """Whether the model is also scored during the last stage."""
    on_surfaces: bool = False
    """Whether the scene's true surfaces are used; the sources that compute them then count as loaders."""
    sources: tuple[str, ...] = EVALUATION
    """Modules that measure; they and their imports decide the metrics."""

    def run(self) -> Callable[..., None]:
        """The function, imported now."""
        assert self.function is not None, self.name
        found: Callable[..., None] = resolve_name(self.function)
        return found


TRAINING = "training"
"""Train a model and score it."""

COST = "cost"
"""Train a model and score it, also during training."""

AUDIT = "audit"
"""Train a model and score it; the cost of training and the method's predictions are metrics too."""

RELIGHTING = "relighting"
"""Train a model and score it; relit views are also compared with the method's reference mode."""

FORWARD_PARITY = "forward-parity"
"""Light transport through surfels against a path tracer's."""

STABILITY = "stability"
"""Hard cases in float32 against float64."""

_TRAIN, _PARITY, _HARD_CASES = (f"radiogs_bench.runs.{name}" for name in ("train", "forward_parity", "hard_cases"))

EXPERIMENTS: Mapping[str, Experiment] = {
    each.name: each
    for each in (
        Experiment(TRAINING, f"{_TRAIN}:train_and_score"),
        Experiment(COST, f"{_TRAIN}:train_and_score_on_the_way", scores_on_the_way=True, sources=(*EVALUATION, _TRAIN)),
        Experiment(AUDIT, f"{_TRAIN}:train_score_and_account", sources=(*EVALUATION, _TRAIN)),
        Experiment(RELIGHTING, f"{_TRAIN}:train_and_score", sources=(*EVALUATION, _TRAIN)),
        Experiment(FORWARD_PARITY, f"{_PARITY}:run_forward_parity", trains=False, on_surfaces=True, sources=(_PARITY,)),
        Experiment(STABILITY, f"{_HARD_CASES}:run_stability", trains=False, sources=(_HARD_CASES,)),
    )
}

FROM_FILES = Experiment(
    "from-files", trains=False, sources=("radiogs_bench.scoring.score_files", "radiogs_baselines.outputs")
)
"""Score images and maps that another program wrote (``score --into``); no suite runs it."""
