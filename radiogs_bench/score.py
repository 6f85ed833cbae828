"""Scoring somebody else's results: a folder of predictions of a scene, under one protocol or several."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from radiogs.scene import Scene
from radiogs_baselines.outputs import Predictions

from .figures import Figures
from .metrics import Protocol
from .schema import MetricValue
from .scoring import Maps, coverage, score_albedo, score_depth, score_view, truth

Advance = Callable[[int, int], None]


@dataclass(frozen=True)
class Score:
    """The figures of one protocol; ``albedo_scale`` is the factor a channel that aligned the albedo, if it was."""

    protocol: Protocol
    metrics: dict[str, MetricValue]
    albedo_scale: list[float] | None


def score_predictions(
    predictions: Predictions, scene: Scene, protocols: Sequence[Protocol], advance: Advance = lambda done, total: None
) -> list[Score]:
    """Compare all that a folder predicts with the scene's ground truth; every file is read once.

    ``advance`` is told (done, total) views. Raises DataError for a damaged file or one of the wrong size.
    """
    figures = [Figures(rules, [view.name for view in scene.test]) for rules in protocols]
    total = len(scene.test) + sum(map(len, predictions.relit.values()))
    kept: dict[str, Maps] = {}
    for done, view in enumerate(scene.test, start=1):
        maps = predictions.read(view, coverage(view))
        for each in figures:
            score_view(each, view, maps)
        kept[view.name] = {name: maps[name] for name in ("albedo", "alpha", "depth") if name in maps}
        advance(done, total)
    done = len(scene.test)
    views = {view.name: view for view in scene.test}
    for light, images in predictions.relit.items():
        for name in images:
            view, mask = views[name], coverage(views[name])
            image, target = predictions.read_relit(light, view, mask), truth(view, f"relit/{light}")
            for each in figures:
                each.add("relight", name, each.rules.score_image(image, target, mask, task="relight"))
            done += 1
            advance(done, total)
    scores = []
    for each in figures:
        score_depth(each, scene, kept)
        scale = score_albedo(each, scene, kept)
        scores.append(Score(each.rules, each.metrics(), None if scale is None else scale.tolist()))
    return scores
