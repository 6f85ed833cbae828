"""Experiments as data: whether a cell is trained, and which sources decide what is measured."""

from collections.abc import Mapping
from dataclasses import dataclass

from radiogs_core.contract import Method

from ..metrics.weights import FILES, missing_weights
from ..sources import code_digest

EVALUATION = ("radiogs_bench.evaluation.evaluate", "radiogs_bench.evaluation.determined")


@dataclass(frozen=True)
class Experiment:
    """A kind of work on a cell; ``experiments.registry`` has the function that does it.

    trains: whether the method is trained. scores_on_the_way: whether the model is also scored during the last stage.
    on_surfaces: whether the scene's true surfaces are used; the sources that compute them then count as loaders.
    sources: modules that measure; they and their imports decide the metrics.
    """

    name: str
    trains: bool = True
    scores_on_the_way: bool = False
    on_surfaces: bool = False
    sources: tuple[str, ...] = EVALUATION

    def evaluation_code(self, method: Method | None = None) -> str:
        """Digest of what turns a trained model, or somebody's files, into metrics.

        It also names the LPIPS networks without weights: once these are installed, results are scored again.
        """
        shown_by = method.sources if self.trains and method is not None else ()
        digest = code_digest(*self.sources, *shown_by)
        missing = [net for net in FILES if missing_weights(net)]
        return f"{digest} without LPIPS weights of {', '.join(missing)}" if missing else digest


TRAINING = "training"
"""Train a model and score it."""

COST = "cost"
"""Train a model and score it, also during training."""

AUDIT = "audit"
"""Train a model and score it; the cost of training and the method's predictions are metrics too."""

FORWARD_PARITY = "forward-parity"
"""Light transport through surfels against a path tracer's."""

STABILITY = "stability"
"""Hard cases in float32 against float64."""

EXPERIMENTS: Mapping[str, Experiment] = {
    each.name: each
    for each in (
        Experiment(TRAINING),
        Experiment(COST, scores_on_the_way=True, sources=(*EVALUATION, "radiogs_bench.experiments.cost")),
        Experiment(AUDIT, sources=(*EVALUATION, "radiogs_bench.experiments.audit")),
        Experiment(
            FORWARD_PARITY, trains=False, on_surfaces=True, sources=("radiogs_bench.experiments.forward_parity",)
        ),
        Experiment(STABILITY, trains=False, sources=("radiogs_bench.experiments.stability",)),
    )
}

FROM_FILES = Experiment(
    "from-files", trains=False, sources=("radiogs_bench.evaluation.score", "radiogs_baselines.outputs")
)
"""Score images and maps that another program wrote (``score --into``); no suite runs it."""
